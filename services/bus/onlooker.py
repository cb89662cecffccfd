"""How a service that only looks on hears and asks: nobody waits for it, and it waits for nobody."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

import zenoh
from zenoh.handlers import FifoChannel, RingChannel

from services.bus.service import Service
from services.wire.codec import decode
from services.wire.errors import TreenailError
from services.wire.messages import Message

M = TypeVar("M", bound=Message)

RING = 4096
"""Messages of one key that may wait; when more come, the oldest are gone. Seconds of a cell at full speed."""
ANSWER_S = 2.0
"""How long an answer is awaited."""
_REPLIES = 16
"""Room for answers to one question; there is one."""


class Inlet(Generic[M]):
    """A subscription whose network side never enters Python and never waits: a ring, newest wins."""

    def __init__(self, service: Service, name: str, kind: type[M], take: Callable[[M], None]) -> None:
        self._service = service
        self._kind = kind
        self._take = take
        self._subscriber = service.session.declare_subscriber(service.keys.of(name), RingChannel(RING))

    def drain(self) -> None:
        """Take what has come, at most one ring full; refuse and count what does not fit the contract."""
        for _ in range(RING):
            sample = self._subscriber.try_recv()
            if sample is None:
                return
            self._service.handled += 1
            try:
                self._take(decode(self._kind, sample.payload.to_bytes(), str(sample.encoding)))
            except TreenailError as error:
                self._service.refuse(error)


class Question(Generic[M]):
    """A query that is asked now and then, and whose answer is looked for without waiting."""

    def __init__(self, service: Service, name: str, kind: type[M]) -> None:
        self._service = service
        self._key = service.keys.of(name)
        self._kind = kind
        self._replies: zenoh.handlers.Handler[zenoh.Reply] | None = None

    def ask(self) -> None:
        """Ask, unless an answer is still awaited."""
        if self._replies is None:
            self._replies = self._service.session.get(self._key, FifoChannel(_REPLIES), timeout=ANSWER_S)

    def answer(self) -> M | None:
        """Return the answer when it has come; refuse and count one that does not fit the contract."""
        if self._replies is None:
            return None
        try:
            reply = self._replies.try_recv()
        except zenoh.ZError:  # closed: nobody answered, or nobody else will
            self._replies = None
            return None
        if reply is None or reply.ok is None:
            return None
        try:
            return decode(self._kind, reply.ok.payload.to_bytes(), str(reply.ok.encoding))
        except TreenailError as error:
            self._service.refuse(error)
            return None
