"""Answers that need somebody else's answer first: the loop goes on meanwhile, and no query is left open."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from services.bus.answers import Asked
from services.bus.service import Service
from services.wire.errors import RefusedError
from services.wire.messages import Message, Refusal

M = TypeVar("M", bound=Message)

MAX_WAITING = 100
"""Queries that may wait at a time; more are refused, so that a flood of them cannot fill the memory."""


class Relay(Generic[M]):
    """Queries to one service that wait for what another key answers."""

    def __init__(self, service: Service, name: str, kind: type[M], timeout_s: float) -> None:
        """``name`` is the key that is asked, and has ``timeout_s`` to answer with a message of ``kind``."""
        self._service = service
        self._name = name
        self._ask = service.later_asker(name, kind, timeout_s)
        self._timeout_s = timeout_s
        self._waiting: list[Asked] = []

    def answer(self, asked: Asked, parameters: str, make: Callable[[M], Message]) -> None:
        """Ask the other key, with ``parameters``, and answer with what ``make`` returns, in the loop, for what it says.

        A Refusal is passed on; without a good answer in time the query is refused as not ready. Raises RefusedError
        when too many queries wait already.
        """
        self._waiting = [waiting for waiting in self._waiting if waiting.open]
        if len(self._waiting) >= MAX_WAITING:
            raise RefusedError(f"{self._name}: expected at most {MAX_WAITING} queries to wait for it, got another one")
        self._waiting.append(asked)

        def then(answer: M | Refusal | None) -> None:
            if asked.open:
                self._service.answering(asked, lambda: asked.reply(make(self._good(answer))))

        self._ask(parameters, then)

    def close(self) -> None:
        """Refuse all that still wait, because the service stops."""
        for asked in self._waiting:
            asked.refuse(RefusedError(f"{self._service.name}: expected to go on, but is stopping"))

    def _good(self, answer: M | Refusal | None) -> M:
        if isinstance(answer, Refusal):
            error = RefusedError(answer.message)
            error.reason = answer.reason
            raise error
        if answer is None:
            raise RefusedError(f"{self._name}: expected a good answer within {self._timeout_s:g} s, got none")
        return answer
