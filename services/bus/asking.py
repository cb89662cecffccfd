"""What is asked of others: with the loop waiting, working on meanwhile, or going on to something else."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import zenoh

from services.bus.answers import to_first
from services.bus.seat import Seat
from services.bus.session import come_after
from services.wire.codec import decode, encode, encoding_of
from services.wire.errors import NoAnswerError
from services.wire.messages import Complete, Message, Refusal

M = TypeVar("M", bound=Message)


class Asking(Seat):
    """A seat that asks."""

    def fetch(self, name: str, kind: type[M], timeout_s: float = 1.0) -> M:
        """Ask a key and return the one good answer; blocks the loop. Raises NoAnswerError or ContractError."""
        messages = self.fetch_all(name, kind, timeout_s)
        if len(messages) != 1:
            raise NoAnswerError(f"{self.keys.of(name)}: expected one answer, got {len(messages)}")
        return messages[0]

    def fetch_all(self, name: str, kind: type[M], timeout_s: float = 1.0) -> list[M]:
        """Ask a key expression and return all good answers in the order of their keys; blocks the loop."""
        samples = self.fetch_samples(name, timeout_s)
        return [decode(kind, sample.payload.to_bytes(), str(sample.encoding)) for sample in samples]

    def fetch_samples(self, name: str, timeout_s: float = 1.0) -> list[zenoh.Sample]:
        """Ask a key expression and return the samples of all good answers, by key; blocks the loop."""
        replies = self.session.get(self.keys.of(name), timeout=timeout_s)
        samples = [reply.ok for reply in replies if reply.ok is not None]
        come_after(self.session, samples)
        return sorted(samples, key=lambda sample: str(sample.key_expr))

    def fetch_stored(self, name: str, timeout_s: float = 1.0) -> list[zenoh.Sample]:
        """Return all that the store has under a key expression, by key; blocks the loop.

        Nothing means that there is nothing. Raises NoAnswerError when the store has not said that this was all.
        """
        samples: list[zenoh.Sample] = []
        told, why = None, "it does not answer"
        for reply in self.session.get(self.keys.of(f"{name}?complete"), timeout=timeout_s):
            if reply.ok is not None:
                samples.append(reply.ok)
            elif reply.err is not None:
                payload, encoding = reply.err.payload.to_bytes(), str(reply.err.encoding)
                if encoding == encoding_of(Complete):
                    told = decode(Complete, payload, encoding).values
                elif encoding == encoding_of(Refusal):
                    why = decode(Refusal, payload, encoding).message
        come_after(self.session, samples)
        if told != len(samples):
            raise NoAnswerError(why)
        return sorted(samples, key=lambda sample: str(sample.key_expr))

    def stored(self, name: str, kind: type[M], timeout_s: float = 1.0) -> list[M]:
        """Return all messages that the store has under a key expression. Raises NoAnswerError, ContractError."""
        samples = self.fetch_stored(name, timeout_s)
        return [decode(kind, sample.payload.to_bytes(), str(sample.encoding)) for sample in samples]

    def asker(self, name: str, kind: type[M], timeout_s: float = 2.0) -> Callable[[Message], M | Refusal | None]:
        """Return a function that asks a key and works on until the answer is here; None when nobody answered."""
        querier = self.session.declare_querier(
            self.keys.of(name), consolidation=zenoh.ConsolidationMode.NONE, timeout=timeout_s, express=True
        )
        self._declared.append(querier)

        def ask(request: Message) -> M | Refusal | None:
            answers: list[M | Refusal | None] = []
            callback = to_first(kind, answers.append, self.post)
            querier.get(handler=callback, payload=encode(request), encoding=encoding_of(type(request)))
            self.inbox.work_until(lambda: bool(answers), timeout_s)
            return answers[0] if answers else None

        return ask

    def later_asker(
        self, name: str, kind: type[M], timeout_s: float
    ) -> Callable[[str, Callable[[M | Refusal | None], None]], None]:
        """Return a function that asks a key, with parameters, and goes on.

        What it is given to call gets the answer in the loop, once, or None when nobody gave a good one.
        """
        querier = self.session.declare_querier(
            self.keys.of(name), consolidation=zenoh.ConsolidationMode.NONE, timeout=timeout_s, express=True
        )
        self._declared.append(querier)

        def ask(parameters: str, then: Callable[[M | Refusal | None], None]) -> None:
            querier.get(parameters=parameters, handler=to_first(kind, then, self.post))

        return ask
