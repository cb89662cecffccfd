"""``tcp://host:port``: a card behind a server of the word protocol, which may be the emulator."""

from __future__ import annotations

import socket

from services.sensor_jr3 import words
from services.sensor_jr3.card import CardError, Collected, LinkError
from services.sensor_jr3.words import Question

CONNECT_S = 2.0
ANSWER_S = 0.25
"""How long an answer may take beyond what was asked to wait; then the card counts as lost."""


class TcpCard:
    """A ``Card`` at the other end of a connection."""

    def __init__(self, host: str, port: int) -> None:
        """Raise LinkError when nobody of our protocol listens there."""
        self._where = f"tcp://{host}:{port}"
        try:
            self._socket = socket.create_connection((host, port), CONNECT_S)
        except (OSError, UnicodeError) as error:
            raise LinkError(f"{self._where}: expected a card server or emulator, got {error}") from None
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            if (got := self._ask(Question(words.HELLO), CONNECT_S)) != list(words.GREETING):
                expected = f"expected version {words.GREETING[-1]} of the word protocol"
                raise LinkError(f"{self._where}: {expected}, got {got[:8]}")
        except CardError:
            self.close()
            raise

    def read(self, address: int, count: int) -> list[int]:
        """Return words, in one round trip."""
        answer = self._ask(Question(words.READ, address, count))
        if len(answer) != count:
            raise LinkError(f"{self._where}: expected {count} words, got {len(answer)}")
        return answer

    def write(self, address: int, value: int) -> None:
        """Write one word."""
        self._ask(Question(words.WRITE, address, value))

    def collect(self, counter: int, data: int, wait_s: float) -> Collected:
        """Return the samples since the last call."""
        wait_ms = max(0, min(words.MOST_WAIT_MS, round(wait_s * 1000)))
        return words.collected_in(self._ask(Question(words.COLLECT, counter, data, wait_ms), ANSWER_S + wait_s))

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def _ask(self, question: Question, within_s: float = ANSWER_S) -> list[int]:
        try:
            self._socket.settimeout(within_s)
            self._socket.sendall(question.pack())
            refused, count = words.answer_head(self._receive(words.ANSWER_BYTES))
            answer = words.unpack(self._receive(2 * count))
        except OSError as error:
            # What comes later would be taken for the answer to another question.
            self._socket.close()
            what = f"an answer within {within_s:g} s" if isinstance(error, TimeoutError) else "a connection"
            raise LinkError(f"{self._where}: expected {what}, got {error}") from None
        if refused:
            raise LinkError(f"{self._where}: {words.text_of(answer)}")
        return answer

    def _receive(self, size: int) -> bytes:
        parts: list[bytes] = []
        while size:
            part = self._socket.recv(size)
            if not part:
                raise ConnectionError("its end")
            parts.append(part)
            size -= len(part)
        return b"".join(parts)
