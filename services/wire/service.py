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
from dataclasses import dataclass
from pathlib import Path
from types import FrameType, TracebackType
from typing import TypeAlias, TypeVar

import zenoh
from zenoh.handlers import Callback

from services.wire.answers import Asked, Request
from services.wire.codec import contract_sha256, decode, encode, encoding_of
from services.wire.errors import CellError, NoAnswerError, TreenailError
from services.wire.keys import Keys
from services.wire.messages import Alive, Message, Refusal
from services.wire.roles import Roles
from services.wire.session import DEFAULT_ENDPOINT, open_client
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


class Service:
    """One service's place in a cell. Use as a context manager; then ``claim``, declare, ``ready`` and ``loop``."""

    def __init__(self, name: str, options: Options) -> None:
        self.name = name
        self.keys = Keys(options.cell)
        self.options = options
        self.log = logging.getLogger(name)
        self.phase = "starting"
        self.run: str | None = None
        self.handled = 0
        self.refused: Counter[str] = Counter()
        self.stopping = False
        self._started_ns = time.time_ns()
        self._beat = 0
        self._next_beat = time.monotonic()
        self._inbox: queue.SimpleQueue[tuple[Callable[..., None], object]] = queue.SimpleQueue()
        self._declared: list[object] = []
        self.contract = contract_sha256()
        self._complained: dict[str, float] = {}

    # -- life ----------------------------------------------------------------------------------------------------

    def __enter__(self) -> Service:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)
        try:
            self.session = open_client(
                self.options.connect, self.options.connect_timeout_s, lambda: self.stopping, self.options.certs
            )
        except CellError:
            if self.stopping:
                raise SystemExit(0) from None
            raise
        self._roles = Roles(self.session, self.keys, self.name)
        self._heartbeat = self.session.declare_publisher(self.keys.heartbeat(self.name), encoding=encoding_of(Alive))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.session.close()  # type: ignore[no-untyped-call]
        if kind is None and self._roles.ousted is not None:
            raise self._roles.ousted

    def claim(self) -> None:
        """Take this service's role in the cell. Raises RoleTakenError when another process keeps it."""
        self._roles.claim(lambda: self.stopping, lambda sample: self._inbox.put((self._note_claim, sample)))
        self.answer(f"alive/{self.name}", lambda _: self.status())

    def ready(self) -> None:
        """Say that the service is alive: it has all it needs and serves its keys."""
        self.phase = "running"
        self._declared.append(self.session.liveliness().declare_token(self.keys.alive(self.name)))
        self.log.info("ready: cell %s, instance %s", self.keys.cell, self._roles.instance)

    def loop(self) -> None:
        """Work until stopped."""
        while not self.stopping:
            self.work(1.0)

    def stop(self) -> None:
        """Make the loop end after the event at hand; safe from any thread."""
        self.stopping = True
        self._inbox.put((_nothing, None))

    def work(self, timeout_s: float) -> bool:
        """Do one event of the inbox, waiting at most ``timeout_s`` for it; True when there was one. Beats the heart."""
        now = time.monotonic()
        if now >= self._next_beat:
            self._next_beat = now + HEARTBEAT_S
            self._beat += 1
            self._heartbeat.put(encode(self.status()))
        try:
            handler, item = self._inbox.get(timeout=max(0.0, min(timeout_s, self._next_beat - now)))
        except queue.Empty:
            return False
        try:
            handler(item)
        except TreenailError as error:
            self.refuse(error)
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
            self._roles.check_sender(sample, roles)
            handler(message)

        self.subscribe_raw(name, take)

    def subscribe_raw(self, name: str, handler: Callable[[zenoh.Sample], None]) -> None:
        """Hand each sample on a key expression to ``handler``, in the loop."""
        callback: Handler = Callback(lambda sample: self._inbox.put((handler, sample)), indirect=False)
        self._declared.append(self.session.declare_subscriber(self.keys.of(name), callback))

    def watch(self, handler: Callable[[str, bool], None]) -> None:
        """Call ``handler(service, alive)`` in the loop for each service that comes or goes, and those already here."""

        def take(sample: zenoh.Sample) -> None:
            handler(str(sample.key_expr).rpartition("/")[2], sample.kind == zenoh.SampleKind.PUT)

        callback: Handler = Callback(lambda sample: self._inbox.put((take, sample)), indirect=False)
        key = self.keys.alive("*")
        self._declared.append(self.session.liveliness().declare_subscriber(key, callback, history=True))

    def answer(self, name: str, handler: Callable[[Request], Message], *parameters: str) -> None:
        """Answer queries on a key with the message that ``handler`` returns in the loop; errors become a Refusal.

        ``parameters`` are the names that a query may have beside ``format``.
        """
        key = self.keys.of(name)

        def take(query: zenoh.Query) -> None:
            asked = Asked(query, key, parameters)
            try:
                asked.reply(handler(asked.request()))
            except TreenailError as error:
                self.refuse(error)
                asked.refuse(error)

        self.answer_raw(name, take)

    def answer_raw(self, name: str, handler: Callable[[zenoh.Query], None]) -> None:
        """Hand each query on a key expression to ``handler``, in the loop; the query is final when it returns."""

        def take(query: zenoh.Query) -> None:
            self.handled += 1
            with query:
                handler(query)

        callback: Handler = Callback(lambda query: self._inbox.put((take, query)), indirect=False)
        self._declared.append(self.session.declare_queryable(self.keys.of(name), callback))

    def refuse(self, error: TreenailError) -> None:
        """Count a refusal by the error's name, and log it now and then."""
        name = type(error).__name__
        self.refused[name] += 1
        self.complain(f"refused ({self.refused[name]} {name}): {error}", topic=name)

    def complain(self, text: str, topic: str | None = None) -> None:
        """Log a warning, at most once a second for one topic (by default the text itself)."""
        now = time.monotonic()
        topic = text if topic is None else topic
        if now - self._complained.get(topic, -_COMPLAINT_EVERY_S) >= _COMPLAINT_EVERY_S:
            self._complained[topic] = now
            self.log.warning("%s", text)

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
        return sorted((reply.ok for reply in replies if reply.ok is not None), key=lambda sample: str(sample.key_expr))

    def asker(self, name: str, kind: type[M], timeout_s: float = 2.0) -> Callable[[Message], M | Refusal | None]:
        """Return a function that asks a key and works on until the answer is here; None when nobody answered."""
        querier = self.session.declare_querier(
            self.keys.of(name), consolidation=zenoh.ConsolidationMode.NONE, timeout=timeout_s, express=True
        )
        self._declared.append(querier)

        def ask(request: Message) -> M | Refusal | None:
            answers: list[M | Refusal | None] = []
            replies: list[zenoh.Reply] = []

            def take(reply: zenoh.Reply) -> None:
                try:
                    answers.append(_answer_in(reply, kind))
                except TreenailError:
                    answers.append(None)
                    raise

            def on_reply(reply: zenoh.Reply) -> None:
                replies.append(reply)
                self._inbox.put((take, reply))

            def on_end() -> None:
                if not replies:  # else the loop knows already, and need not be woken once more
                    self._inbox.put((answers.append, None))

            callback: Callback[zenoh.Reply] = Callback(on_reply, on_end, indirect=False)
            querier.get(handler=callback, payload=encode(request), encoding=encoding_of(type(request)))
            self.work_until(lambda: bool(answers), timeout_s)
            return answers[0] if answers else None

        return ask

    def put(self, key: str, message: Message) -> None:
        """Put a message on a full key, reliably; a put is no proof of storage, only reading it back is."""
        self.session.put(
            key, encode(message), encoding=encoding_of(type(message)), congestion_control=zenoh.CongestionControl.BLOCK
        )

    def status(self) -> Alive:
        """Return who this is and how it goes."""
        return Alive(
            service=self.name,
            instance=self._roles.instance,
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

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.stop()

    def _note_claim(self, sample: zenoh.Sample) -> None:
        self._roles.note(sample)
        if self._roles.ousted is not None:
            self.stop()


def _answer_in(reply: zenoh.Reply, kind: type[M]) -> M | Refusal | None:
    """Return the message in a reply, or why it was refused; None for an error of Zenoh's own, such as a time-out."""
    if reply.ok is not None:
        return decode(kind, reply.ok.payload.to_bytes(), str(reply.ok.encoding))
    if reply.err is not None and str(reply.err.encoding) == encoding_of(Refusal):
        return decode(Refusal, reply.err.payload.to_bytes(), encoding_of(Refusal))
    return None


def _nothing(_: object) -> None:
    """Wake the loop."""
