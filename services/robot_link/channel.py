"""What lies between the dialogue and the wire: a text line to the controller, over plain bytes or over DDCMP. Pure.

A channel neither reads a clock nor touches a port: bytes that came in and the time are arguments, bytes to send are
what it returns. Who owns the port sends them in the order in which they were returned. Times are seconds of any
clock that does not go back.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol


class Received(NamedTuple):
    """What came of bytes from the wire."""

    text: bytes = b""
    """What the controller said, in order; may be empty."""
    reply: bytes = b""
    """Bytes to send at once, such as an acknowledgement; may be empty."""


class Channel(Protocol):
    """One text line to the controller. Not for several threads."""

    @property
    def up(self) -> bool:
        """Whether text can be sent now."""
        ...

    @property
    def failure(self) -> str | None:
        """Why nothing can be sent or come any more until ``start``, in one line; None as long as all is well."""
        ...

    @property
    def next_deadline_s(self) -> float | None:
        """When ``tick`` must be called at the latest; None when only bytes can change anything."""
        ...

    def start(self, now_s: float) -> bytes:
        """Begin afresh after the port was opened, also after a failure; return bytes to send."""
        ...

    def send(self, text: bytes, now_s: float) -> bytes:
        """Take text for the controller, also before the channel is up; return bytes to send now."""
        ...

    def receive(self, data: bytes, now_s: float) -> Received:
        """Take bytes from the wire, in any pieces."""
        ...

    def tick(self, now_s: float) -> bytes:
        """Let time pass; return bytes to send."""
        ...


class RawChannel:
    """A plain serial line: the text is the bytes, and it is up once the port is open."""

    def __init__(self) -> None:
        self.up = False
        self.failure: str | None = None
        self.next_deadline_s: float | None = None

    def start(self, now_s: float) -> bytes:
        """See Channel."""
        self.up = True
        return b""

    def send(self, text: bytes, now_s: float) -> bytes:
        """See Channel."""
        return text

    def receive(self, data: bytes, now_s: float) -> Received:
        """See Channel."""
        return Received(data)

    def tick(self, now_s: float) -> bytes:
        """See Channel."""
        return b""
