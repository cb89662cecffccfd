"""The serving end of the word protocol: one card for those who connect, a thread each, one question at a time."""

from __future__ import annotations

import socket
import socketserver
import threading
import time

from services.sensor_jr3 import words
from services.sensor_jr3.card import Card, CardError, LinkError
from services.sensor_jr3.words import Question
from services.wire.text import one_line

COLLECTOR_S = 1.0
"""A connection that has not collected for so long may be replaced as the one that does."""
_BACKLOG = 16
"""Calls that empty the fullest card."""


class WordServer(socketserver.ThreadingTCPServer):
    """Serves one card; use as a context manager round ``serve_forever``."""

    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, card: Card, host: str, port: int) -> None:
        """Raise LinkError when the address cannot be listened on. ``port`` may be 0 for a free one."""
        self._card = card
        self._lock = threading.Lock()
        self._collector: object | None = None
        self._collected_s = 0.0
        try:
            super().__init__((host, port), _Connection)
        except (OSError, OverflowError) as error:
            raise LinkError(f"card server: cannot listen on {host}:{port}: {error}") from None

    @property
    def port(self) -> int:
        """Return where it listens."""
        return int(self.server_address[1])

    def ask(self, question: Question, whose: object) -> bytes:
        """Return the answer to a question."""
        try:
            with self._lock:
                return words.answer(self._do(question, whose))
        except CardError as error:
            return words.refusal(one_line(str(error)))

    def _do(self, question: Question, whose: object) -> list[int]:
        operation, a, b, c = question
        if operation == words.HELLO:
            return list(words.GREETING)
        if operation == words.READ:
            if not (1 <= b <= words.MOST_WORDS and a + b <= 0x10000):
                raise LinkError(f"read: expected 1 to {words.MOST_WORDS} words below 10000, got {b} at {a:04X}")
            return self._card.read(a, b)
        if operation == words.WRITE:
            self._card.write(a, b)
            return []
        if operation == words.COLLECT:
            return self._collect(whose, a, b, c)
        raise LinkError(f"operation: expected {words.HELLO} to {words.COLLECT}, got {operation}")

    def _collect(self, whose: object, counter: int, data: int, wait_ms: int) -> list[int]:
        if wait_ms > words.MOST_WAIT_MS or data + 6 > 0x10000:
            raise LinkError(f"collect: expected at most {words.MOST_WAIT_MS} ms, got {wait_ms}, data at {data:04X}")
        now = time.monotonic()
        if self._collector not in (None, whose) and now < self._collected_s + COLLECTOR_S:
            raise LinkError("collect: expected to be the only one who collects, but another connection does")
        if self._collector is not whose:
            self._collector = whose
            self._forget(counter, data)
        collected = self._card.collect(counter, data, wait_ms / 1000)
        self._collected_s = time.monotonic()
        return words.collected_words(collected)

    def release(self, whose: object) -> None:
        """Let another connection collect: this one has ended."""
        with self._lock:
            if self._collector is whose:
                self._collector = None

    def _forget(self, counter: int, data: int) -> None:
        """Drop what was taken for somebody else: it may be from before the card was set up."""
        for _ in range(_BACKLOG):
            if not self._card.collect(counter, data, 0.0).samples:
                return


class _Connection(socketserver.BaseRequestHandler):
    """Answers one connection's questions until it ends."""

    server: WordServer
    request: socket.socket

    def handle(self) -> None:
        self.request.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        stream = self.request.makefile("rb")
        try:
            while len(data := stream.read(words.QUESTION_BYTES)) == words.QUESTION_BYTES:
                self.request.sendall(self.server.ask(words.question(data), self))
        except OSError:
            return  # gone; whoever needs the card connects again
        finally:
            self.server.release(self)
