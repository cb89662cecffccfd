"""The controller in supervisor mode: its terminal's text in DDCMP messages. Pure.

As soon as both ends have come together it asks for text (logical unit 2, read), as VAL II was seen to do. The host's
answer goes to the terminal, what the terminal says comes back as writes, and then it asks again. Only the read's bytes
are known; how answers and writes begin is a guess, the same as in ``services.robot_link.ddcmp.logical_units``.
"""

from __future__ import annotations

from typing import Protocol

from services.robot_link.emulator.supervisory_line import MOST_BYTES, ControllerLine

READ = b"\x02\x02\x00\x00"
ANSWER = b"\x02\x02\x00\x00"
WRITE = b"\x02\x03\x00\x00"


class ControllerText(Protocol):
    """A terminal that speaks plain text."""

    @property
    def next_deadline_s(self) -> float | None:
        """When ``tick`` has something to do; None when only text can change anything."""
        ...

    def receive(self, text: bytes, now_s: float) -> bytes:
        """Take what is typed; return what is shown."""
        ...

    def tick(self, now_s: float) -> bytes:
        """Let time pass; return what is shown."""
        ...


class SupervisoryController:
    """The controller's end of a supervisor line round a terminal."""

    def __init__(
        self,
        terminal: ControllerText,
        line: ControllerLine | None = None,
        *,
        read: bytes = READ,
        answer: bytes = ANSWER,
        write: bytes = WRITE,
    ) -> None:
        """Take the terminal, the line (a usual one if none is given) and the messages' prefixes."""
        self.line = line or ControllerLine()
        self._terminal = terminal
        self._read, self._answer, self._write = read, answer, write
        self._begun = 0

    @property
    def next_deadline_s(self) -> float | None:
        """When ``tick`` must be called at the latest; None when only bytes can change anything."""
        times_s = (self.line.next_deadline_s, self._terminal.next_deadline_s)
        return min((time_s for time_s in times_s if time_s is not None), default=None)

    def start(self, now_s: float) -> bytes:
        """Turn the supervisor switch on; return bytes to send."""
        self._begun = self.line.begun
        return self.line.start(now_s)

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Take bytes from the line; return bytes to send."""
        out = self.line.receive(data, now_s)
        if self.line.begun != self._begun:
            self._begun = self.line.begun
            out += self.line.put(self._read, now_s)
        for message in self.line.messages:
            if message.startswith(self._answer):
                out += self._say(self._terminal.receive(message[len(self._answer) :], now_s), now_s)
                out += self.line.put(self._read, now_s)
            else:
                self.line.troubles.append(f"the host sent a message that does not begin with {self._answer.hex(' ')}")
        self.line.messages.clear()
        return out

    def tick(self, now_s: float) -> bytes:
        """Let time pass; return bytes to send."""
        return self.line.tick(now_s) + self._say(self._terminal.tick(now_s), now_s)

    def _say(self, text: bytes, now_s: float) -> bytes:
        """Return the bytes of text in as many writes as it takes. Nobody sees it while the line is down."""
        if not self.line.running:
            return b""
        room = MOST_BYTES - len(self._write)
        pieces = (text[at : at + room] for at in range(0, len(text), room))
        return b"".join(self.line.put(self._write + piece, now_s) for piece in pieces)
