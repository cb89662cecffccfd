"""What stands between the keys and the line, and between the line and the screen. Pure."""

from __future__ import annotations

LINE_ENDS = {"cr": b"\r", "lf": b"\n", "crlf": b"\r\n"}
QUIT_KEY = 0x1D
"""Ctrl-]."""
_DELETE = 0x7F
_FILL = (0x00, 0x7F, 0xFF)
_HARMLESS = (0x07, 0x08, 0x09)
_CR, _LF = 0x0D, 0x0A


class Keyboard:
    """Turns what is typed into what is sent."""

    def __init__(self, line_end: bytes, backspace: bytes = b"\x7f") -> None:
        self._line_end, self._backspace = line_end, backspace

    def keys(self, typed: bytes) -> tuple[bytes, bool]:
        """Return what to send, and whether the quit key was among it; what follows that key is dropped."""
        before, quit_key, _ = typed.partition(bytes((QUIT_KEY,)))
        sent = b"".join(self._key(key) for key in before)
        return sent, bool(quit_key)

    def _key(self, key: int) -> bytes:
        if key in (_CR, _LF):
            return self._line_end
        return self._backspace if key == _DELETE else bytes((key,))


class Screen:
    """Turns what comes into text with newlines at line ends.

    CR LF, CR and LF all end a line. Fill characters (00, 7F, FF) are dropped; other bytes that are not printable ASCII
    are shown as ``<8D>``, so that a wrong parity is seen and nothing from the line can command the terminal.
    """

    def __init__(self) -> None:
        self._after_cr = False

    def show(self, came: bytes) -> str:
        """Return the text of what has come, in pieces of any size."""
        return "".join(self._one(byte) for byte in came if byte not in _FILL)

    def _one(self, byte: int) -> str:
        after_cr, self._after_cr = self._after_cr, byte == _CR
        if byte == _LF and after_cr:
            return ""
        if byte in (_CR, _LF):
            return "\n"
        if 0x20 <= byte < 0x7F or byte in _HARMLESS:
            return chr(byte)
        return f"<{byte:02X}>"


class EchoFilter:
    """Drops the controller's echo of a line that the terminal has shown already while it was edited."""

    def __init__(self) -> None:
        self._expected = ""

    def sent(self, line: str) -> None:
        """Expect the echo of a line, its newline included."""
        self._expected += line

    def show(self, text: str) -> str:
        """Return a text without the echo; what differs ends it, and is shown from there on."""
        count = 0
        while count < min(len(text), len(self._expected)) and text[count] == self._expected[count]:
            count += 1
        self._expected = self._expected[count:] if count == len(text) else ""
        return text[count:]
