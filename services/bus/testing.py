"""A service without a process: its shell runs on a bus in memory, by a clock that only waiting moves.

    service = FakeService("agent")
    service.bus.answers["experiment"] = experiment
    service.later(1.0, lambda: service.hear("state", state))
    service.run(attend, for_s=5.0)
    assert service.published(Action) == [...]

All of ``Service`` is the real one, down to encoding and checking; in the place of Zenoh's session stands FakeBus, which
keeps what is put where the store would keep it, and gives the answers that a test has laid out.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from typing import TypeVar, cast

import zenoh

from services.bus.answers import answer_in
from services.bus.fake_bus import FakeBus, FakeQuery, FakeSample, FakeSession
from services.bus.inbox import Event, Inbox
from services.bus.service import Options, Service
from services.wire.codec import decode, encode, encoding_of
from services.wire.keys import CLAIM, name_of
from services.wire.messages import Message, Refusal

M = TypeVar("M", bound=Message)
STRANGER = "bad"
"""Session of somebody who holds no role."""


class FakeInbox(Inbox):
    """A loop whose time passes only while it waits: no test sleeps."""

    def __init__(self) -> None:
        self.time_s = 1000.0
        self._due: list[tuple[float, int, Callable[[], object]]] = []
        self._numbered = 0
        super().__init__()

    def now(self) -> float:
        """Return the time that waiting has come to [s]."""
        return self.time_s

    def at(self, time_s: float, do: Callable[[], object]) -> None:
        """Have ``do`` called when time has come so far; what is due together is done in the order of asking."""
        self._numbered += 1
        heapq.heappush(self._due, (time_s, self._numbered, do))

    def _take(self, timeout_s: float) -> Event | None:
        deadline = self.time_s + timeout_s
        while self._events.empty() and self._due and self._due[0][0] <= deadline:
            time_s, _, do = heapq.heappop(self._due)
            self.time_s = max(self.time_s, time_s)
            do()
        if not self._events.empty():
            return self._events.get_nowait()
        self.time_s = deadline
        return None


class FakeService(Service):
    """A service on a bus in memory, with what a test needs to see and to do."""

    def __init__(self, name: str, bus: FakeBus | None = None, cell: str = "a", zid: str = "a1") -> None:
        """``bus`` may be that of a service before it, whose puts are then in the store; ``zid`` names the session."""
        super().__init__(name, Options(cell))
        self.bus = FakeBus() if bus is None else bus
        self.clock = FakeInbox()
        self.inbox = self.clock
        self.session = cast("zenoh.Session", FakeSession(self.bus, zid))

    def later(self, after_s: float, do: Callable[[], object]) -> None:
        """Have something done when the service has waited so long from now on."""
        self.clock.at(self.clock.now() + after_s, do)

    def run_for(self, work: Callable[[Service], object], seconds: float) -> None:
        """Claim the role, and let ``work`` have the service until it is told to stop after ``seconds``."""
        self.later(seconds, self.stop)
        self.claim()
        work(self)

    def settle(self) -> None:
        """Do all that has come in; no time passes."""
        while self.work(0.0):
            continue

    def hold(self, role: str, session: str) -> None:
        """Let another session hold a role in this cell from now on."""
        self.bus.token(self.keys.of(name_of(CLAIM, service=role, instance=f"{1:020d}-{session}")), here=True)

    def hear(self, name: str, message: Message, sender: str = STRANGER) -> None:
        """Let a message of another session come in."""
        self.hear_raw(name, encode(message), encoding_of(type(message)), sender)

    def hear_raw(self, name: str, payload: bytes, encoding: str, sender: str = STRANGER) -> None:
        """Let any bytes come in."""
        key, stamp = zenoh.KeyExpr(self.keys.of(name)), self.bus.timestamp(sender)
        self.bus.put(FakeSample(key, zenoh.ZBytes(payload), zenoh.Encoding(encoding), stamp))

    def ask(self, selector: str, request: Message | None = None) -> FakeQuery:
        """Ask the service something; it answers when it works."""
        payload = None if request is None else encode(request)
        query = FakeQuery(self.keys.of(selector), payload, None if request is None else encoding_of(type(request)))
        for key, handler in list(self.bus.queryables):
            if key.intersects(query.key_expr):
                handler(query)
        return query

    def answer_to(self, kind: type[M], selector: str, request: Message | None = None) -> M | Refusal | None:
        """Ask the service something and return what it says to it at once; None for nothing."""
        query = self.ask(selector, request)
        self.settle()
        return answer_in(cast("zenoh.Reply", query.replies[0]), kind) if query.replies else None

    def published(self, kind: type[M]) -> list[M]:
        """Return all messages of a type that were put on the bus, by whomever, in order."""
        puts = self.bus.published
        return [decode(kind, payload, encoding) for _, payload, encoding in puts if encoding == encoding_of(kind)]

    def store(self, key: str, message: Message) -> None:
        """Let the store have a message on a full key."""
        self.session.put(key, encode(message), encoding=encoding_of(type(message)))
