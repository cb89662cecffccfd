"""The shell that every service stands in: session, role, inbox, queries, heartbeat, stop.

Network callbacks only put what came into the inbox; one loop per service does all the work, and nothing that comes in
can stop it: what does not fit is refused, counted and logged.
"""

from __future__ import annotations

import logging
import os
import queue
import signal
import socket
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType, TracebackType
from typing import TypeAlias, TypeVar

import zenoh
from zenoh.handlers import Callback

from services.bus.answers import Asked, Request, to_first
from services.bus.heartbeat import touch_heartbeat
from services.bus.memory import give_back
from services.bus.roles import Roles, take_role
from services.bus.session import DEFAULT_ENDPOINT, come_after, open_client
from services.wire.codec import contract_sha256, decode, encode, encoding_of
from services.wire.errors import BadPayloadError, CellError, NoAnswerError, TreenailError
from services.wire.keys import Keys
from services.wire.messages import Alive, Message, Refusal
from services.wire.text import one_line
from services.wire.version import version

M = TypeVar("M", bound=Message)
T = TypeVar("T")
Handler: TypeAlias = "Callback[object]"

HEARTBEAT_S = 1.0
_COMPLAINT_EVERY_S = 1.0


@dataclass(frozen=True)
class Options:
    """What every service is started with."""

    cell: str = "a"
    """Name of the cell."""
    connect: tuple[str, ...] = (DEFAULT_ENDPOINT,)
    """Zenoh endpoints of the router, tried in turn."""
    connect_timeout_s: float = 30.0
    """How long to wait for the router at the start."""
    certs: Path | None = None
    """Folder with ca.pem, cert.pem and key.pem for mutual TLS; None without."""
    fleet: int | None = None
    """Number of cells, named 1 and up, in one of which this service shall stand: the first without one."""

    @property
    def cells(self) -> tuple[str, ...]:
        """Names of the cells that come into question."""
        return (self.cell,) if self.fleet is None else tuple(str(number + 1) for number in range(self.fleet))


class Service:
    """One service's place in a cell. Use as a context manager; then ``claim``, declare, ``ready`` and ``loop``."""

    def __init__(self, name: str, options: Options) -> None:
        self.name = name
        self.keys = Keys(options.cells[0])
        """Keys of the cell; in a fleet it is known once claimed."""
        self.options = options
        self.log = logging.getLogger(name)
        self.phase = "starting"
        self.run: str | None = None
        self.handled = 0
        self.refused: Counter[str] = Counter()
        self.stopping = False
        self._refused_payload = False
        """Since the last heartbeat; it may have been a large one."""
        self._started_ns = time.time_ns()
        self._beat = 0
        self._next_beat = time.monotonic()
        self._inbox: queue.SimpleQueue[tuple[Service, Callable[..., None], object]] = queue.SimpleQueue()
        self._declared: list[object] = []
        self.contract = contract_sha256()
        self._complained: dict[str, float] = {}
        self._roles: Roles | None = None
        self._neighbours: list[Service] = []
        self._host = self

    # -- life ----------------------------------------------------------------------------------------------------

    def __enter__(self) -> Service:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)
        try:
            self.session = open_client(
                self.options.connect,
                self.options.connect_timeout_s,
                lambda: self.stopping,
                self.options.certs,
                self.name,
            )
        except CellError:
            if self.stopping:
                raise SystemExit(0) from None
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.session.close()  # type: ignore[no-untyped-call]
        for roles in (self._roles, *(other._roles for other in self._neighbours)):
            if kind is None and roles is not None and roles.ousted is not None:
                raise roles.ousted

    def claim(self) -> None:
        """Take this service's role in the cell, or in one of a fleet. Raises RoleTakenError when others keep it."""
        cells = [Keys(cell) for cell in self.options.cells]
        self._roles = take_role(self.session, cells, self.name, lambda: self.stopping)
        self.keys = self._roles.keys
        self._roles.follow(lambda sample: self._post((self._note_claim, sample)))
        self._heartbeat = self.session.declare_publisher(self.keys.heartbeat(self.name), encoding=encoding_of(Alive))
        self.answer(f"alive/{self.name}", lambda _: self.status())

    def claim_all(self) -> list[Service]:
        """Take this service's role in every cell of a fleet; return its place in each, all served by one loop."""
        self._neighbours = [
            Service(self.name, replace(self.options, cell=cell, fleet=None)) for cell in self.options.cells
        ]
        for place in self._neighbours:
            place.session, place._inbox, place._host = self.session, self._inbox, self
            place.claim()
        return list(self._neighbours)

    @property
    def place(self) -> int:
        """Number of the cell in its fleet, from 0; 0 without a fleet."""
        return self.options.cells.index(self.keys.cell)

    def ready(self) -> None:
        """Say that the service is alive: it has all it needs and serves its keys."""
        self.phase = "running"
        self._declared.append(self.session.liveliness().declare_token(self.keys.alive(self.name)))
        self.log.info("ready: cell %s, instance %s", self.keys.cell, self._instance)

    def loop(self) -> None:
        """Work until stopped."""
        while not self.stopping:
            self.work(1.0)

    def stop(self) -> None:
        """Make the loop end after the event at hand; safe from any thread."""
        self.stopping = True
        self._post((_nothing, None))

    def work(self, timeout_s: float) -> bool:
        """Do one event of the inbox, waiting at most ``timeout_s`` for it; True when there was one. Beats the heart."""
        now = time.monotonic()
        if now >= self._next_beat:
            self._next_beat = now + HEARTBEAT_S
            touch_heartbeat()
            for place in (self, *self._neighbours):
                place._publish_heartbeat()
            if self._refused_payload:
                self._refused_payload = False
                give_back()
        try:
            place, handler, item = self._inbox.get(timeout=max(0.0, min(timeout_s, self._next_beat - now)))
        except queue.Empty:
            return False
        try:
            handler(item)
        except TreenailError as error:
            place.refuse(error)
        return True

    def work_until(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """Work until ``done()``, stop, or the end of ``timeout_s``; return ``done()``."""
        deadline = time.monotonic() + timeout_s
        while not done():
            left = deadline - time.monotonic()
            if left <= 0 or self.stopping:
                return done()
            self.work(left)
        return True

    def wait_for(self, what: str, attempt: Callable[[], T | None], every_s: float = 0.1) -> T | None:
        """Try until ``attempt`` gives something, saying loudly what is missing; None only when stopped."""
        before = self.phase
        while not self.stopping:
            result = attempt()
            if result is not None:
                self.phase = before
                return result
            self.phase = f"waiting for {what}"
            self.complain(self.phase)
            self.work_until(lambda: False, every_s)
        return None

    # -- what came in --------------------------------------------------------------------------------------------

    def subscribe(self, name: str, kind: type[M], handler: Callable[[M], None], *roles: str) -> None:
        """Hand each message on a key to ``handler``, in the loop: with ``roles``, only those of who holds one of them.

        As long as nobody has held any of the roles, everybody is heard.
        """

        def take(sample: zenoh.Sample) -> None:
            self.handled += 1
            message = decode(kind, sample.payload.to_bytes(), str(sample.encoding))
            if self._roles is not None:
                self._roles.check_sender(sample, roles)
            handler(message)

        self.subscribe_raw(name, take)

    def subscribe_raw(self, name: str, handler: Callable[[zenoh.Sample], None]) -> None:
        """Hand each sample on a key expression to ``handler``, in the loop."""
        callback: Handler = Callback(lambda sample: self._post((handler, sample)), indirect=False)
        self._declared.append(self.session.declare_subscriber(self.keys.of(name), callback))

    def watch(self, handler: Callable[[str, bool], None]) -> None:
        """Call ``handler(service, alive)`` in the loop for each service that comes or goes, and those already here."""

        def take(sample: zenoh.Sample) -> None:
            handler(str(sample.key_expr).rpartition("/")[2], sample.kind == zenoh.SampleKind.PUT)

        callback: Handler = Callback(lambda sample: self._post((take, sample)), indirect=False)
        key = self.keys.alive("*")
        self._declared.append(self.session.liveliness().declare_subscriber(key, callback, history=True))

    def answer(self, name: str, handler: Callable[[Request], Message], *parameters: str) -> None:
        """Answer queries on a key with the message that ``handler`` returns in the loop; errors become a Refusal.

        ``parameters`` are the names that a query may have beside ``format``.
        """
        self.answer_later(name, lambda asked, request: asked.reply(handler(request)), *parameters)

    def answer_later(self, name: str, handler: Callable[[Asked, Request], None], *parameters: str) -> None:
        """Like ``answer``, but ``handler`` itself answers what was asked, or sees to it that this is done later."""
        key = self.keys.of(name)

        def take(query: zenoh.Query) -> None:
            self.handled += 1
            asked = Asked(query, key, parameters)
            self.answering(asked, lambda: handler(asked, asked.request()))

        callback: Handler = Callback(lambda query: self._post((take, query)), indirect=False)
        self._declared.append(self.session.declare_queryable(key, callback))

    def answering(self, asked: Asked, answer: Callable[[], None]) -> None:
        """Call ``answer``; an error that it raises is counted and is the answer to what was asked."""
        try:
            answer()
        except TreenailError as error:
            self.refuse(error)
            asked.refuse(error)

    def answer_raw(self, name: str, handler: Callable[[zenoh.Query], None]) -> None:
        """Hand each query on a key expression to ``handler``, in the loop; the query is final when it returns."""

        def take(query: zenoh.Query) -> None:
            self.handled += 1
            with query:
                handler(query)

        callback: Handler = Callback(lambda query: self._post((take, query)), indirect=False)
        self._declared.append(self.session.declare_queryable(self.keys.of(name), callback))

    def refuse(self, error: TreenailError) -> None:
        """Count a refusal by the error's name, and log it now and then."""
        name = type(error).__name__
        self.refused[name] += 1
        self._host._refused_payload |= isinstance(error, BadPayloadError)
        self.complain(f"refused ({self.refused[name]} {name}): {error}", topic=name)

    def complain(self, text: str, topic: str | None = None) -> None:
        """Log a warning, at most once a second for one topic (by default the text itself)."""
        now = time.monotonic()
        topic = text if topic is None else topic
        if now - self._complained.get(topic, -_COMPLAINT_EVERY_S) >= _COMPLAINT_EVERY_S:
            self._complained[topic] = now
            self.log.warning("%s", one_line(text, 500))

    # -- what goes out -------------------------------------------------------------------------------------------

    def publisher(self, name: str, kind: type[M], *, drop: bool = False) -> Callable[[M], None]:
        """Return a function that publishes messages on a key: reliable and blocking, or dropping for telemetry."""
        control = zenoh.CongestionControl.DROP if drop else zenoh.CongestionControl.BLOCK
        publisher = self.session.declare_publisher(
            self.keys.of(name), encoding=encoding_of(kind), congestion_control=control, express=True
        )
        self._declared.append(publisher)
        return lambda message: publisher.put(encode(message))

    def fetch(self, name: str, kind: type[M], timeout_s: float = 1.0) -> M:
        """Ask a key and return the one good answer; blocks the loop. Raises NoAnswerError or ContractError."""
        found = self.fetch_all(name, kind, timeout_s)
        if len(found) != 1:
            raise NoAnswerError(f"{self.keys.of(name)}: expected one answer, got {len(found)}")
        return found[0]

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

    def asker(self, name: str, kind: type[M], timeout_s: float = 2.0) -> Callable[[Message], M | Refusal | None]:
        """Return a function that asks a key and works on until the answer is here; None when nobody answered."""
        querier = self.session.declare_querier(
            self.keys.of(name), consolidation=zenoh.ConsolidationMode.NONE, timeout=timeout_s, express=True
        )
        self._declared.append(querier)

        def ask(request: Message) -> M | Refusal | None:
            answers: list[M | Refusal | None] = []
            callback = to_first(kind, answers.append, self._post)
            querier.get(handler=callback, payload=encode(request), encoding=encoding_of(type(request)))
            self.work_until(lambda: bool(answers), timeout_s)
            return answers[0] if answers else None

        return ask

    def ask_later(self, name: str, kind: type[M], then: Callable[[M | Refusal | None], None], timeout_s: float) -> None:
        """Ask a key and go on; ``then`` gets the answer in the loop, once, or None when nobody gave a good one."""
        self.session.get(
            self.keys.of(name),
            to_first(kind, then, self._post),
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=timeout_s,
            express=True,
        )

    def put(self, key: str, message: Message) -> None:
        """Put a message on a full key, reliably; a put is no proof of storage, only reading it back is."""
        self.session.put(
            key, encode(message), encoding=encoding_of(type(message)), congestion_control=zenoh.CongestionControl.BLOCK
        )

    def status(self) -> Alive:
        """Return who this is and how it goes."""
        return Alive(
            service=self.name,
            instance=self._instance,
            host=socket.gethostname(),
            pid=os.getpid(),
            version=version(),
            contract_sha256=self.contract,
            started_t_ns=self._started_ns,
            beat=self._beat,
            handled=self.handled,
            refused=dict(self.refused),
            run=self.run,
            phase=self.phase,
        )

    # -- details -------------------------------------------------------------------------------------------------

    def _post(self, event: tuple[Callable[..., None], object]) -> None:
        """Have the loop do something; safe from any thread, and never waits."""
        self._inbox.put((self, *event))

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.stop()

    @property
    def _instance(self) -> str:
        return "" if self._roles is None else self._roles.instance

    def _publish_heartbeat(self) -> None:
        if self._roles is not None:
            self._beat += 1
            self._heartbeat.put(encode(self.status()))

    def _note_claim(self, sample: zenoh.Sample) -> None:
        if self._roles is not None:
            self._roles.note(sample)
            if self._roles.ousted is not None:
                self._host.stop()


def _nothing(_: object) -> None:
    """Wake the loop."""
