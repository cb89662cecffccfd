"""What DDCMP messages between supervisor and controller mean: reads and writes of logical units. Pure.

Next to nothing of this is public. One message has been seen on a real line: as soon as the supervisor switch is on,
the controller sends 02 02 00 00, which the thesis calls "LUN2 READ". So the controller asks, and what the host has to
say is the answer. All else in ``TABLE`` is a guess, which is why every prefix is a setting.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from services.robot_link.ddcmp.settings import DdcmpError


class Row(NamedTuple):
    """One kind of message."""

    prefix: bytes
    sender: str
    meaning: str
    confidence: str
    """S sure, L likely, U unknown."""


TABLE = {
    "read": Row(b"\x02\x02\x00\x00", "controller", "asks for text of unit 2, the terminal; alone in its message", "S"),
    "answer": Row(b"\x02\x02\x00\x00", "host", "text that was asked for follows", "U"),
    "write": Row(b"\x02\x03\x00\x00", "controller", "text that the terminal would show follows", "U"),
}


class Kind(Enum):
    """What the controller wants."""

    READ = "read"
    WRITE = "write"


@dataclass(frozen=True)
class LogicalUnits:
    """Prefixes of the messages. Raises DdcmpError for prefixes that cannot be told apart."""

    read: bytes = TABLE["read"].prefix
    """The whole of a message in which the controller asks for text (bytes S)."""
    answer: bytes = TABLE["answer"].prefix
    """Before the host's text (U)."""
    write: bytes = TABLE["write"].prefix
    """Before the controller's text (U); may equal ``read``, since no text follows that."""

    def __post_init__(self) -> None:
        if not self.read:
            raise DdcmpError("logical units: read: expected at least one byte, got none")
        if self.read != self.write and self.read.startswith(self.write):
            got = f"{self.read.hex(' ')} and {self.write.hex(' ') or 'none'}"
            raise DdcmpError(f"logical units: expected a read that does not begin like a write, got {got}")

    def message_of(self, text: bytes) -> bytes:
        """Return the message that answers a read with text."""
        return self.answer + text

    def parse(self, message: bytes) -> tuple[Kind, bytes]:
        """Return what a message of the controller is, and its text. Raises DdcmpError for one that is unknown."""
        if message == self.read:
            return Kind.READ, b""
        if message.startswith(self.write):
            return Kind.WRITE, message[len(self.write) :]
        expected = f"{self.read.hex(' ')} alone (read) or {self.write.hex(' ')} and text (write)"
        raise DdcmpError(f"supervisor line: expected {expected}, got {_in_hex(message)}")


def prefix_of(text: str) -> bytes:
    """Return the bytes of a prefix written in hexadecimal, such as ``02 02 00 00``. Raises DdcmpError."""
    try:
        return bytes.fromhex(text)
    except ValueError:
        raise DdcmpError(f"logical units: expected hexadecimal bytes such as 02 02 00 00, got {text!r}") from None


def _in_hex(message: bytes) -> str:
    most = 16
    return message[:most].hex(" ") + (f" ... ({len(message)} bytes)" if len(message) > most else "")
