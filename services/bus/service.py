"""The shell that every service stands in: session, role, what comes in, heartbeat, stop.

Network callbacks only put what came into the inbox; one loop per service does all the work, and nothing that comes in
can stop it: what does not fit is refused, counted and logged. What goes out is in ``publishing`` and ``asking``.
"""

from __future__ import annotations

import logging
import os
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

from services.bus.answers import Asked, Request
from services.bus.asking import Asking
from services.bus.free_memory import give_back
from services.bus.heartbeat import touch_heartbeat
from services.bus.inbox import Inbox
from services.bus.publishing import Publishing
from services.bus.rights import Rights
from services.bus.roles import Roles, take_role
from services.bus.room import Room
from services.bus.session import DEFAULT_ENDPOINT, open_client
from services.wire.codec import contract_sha256, decode, encode, encoding_of
from services.wire.errors import (
    BadPayloadError,
    CellError,
    ContractError,
    NoAnswerError,
    RoleTakenError,
    TreenailError,
)
from services.wire.keys import ALIVE, EXPERIMENT, READERS, Keys, name_of
from services.wire.messages import Alive, Experiment, Message
from services.wire.text import one_line
from services.wire.version import version

M = TypeVar("M", bound=Message)
T = TypeVar("T")
Handler: TypeAlias = "Callback[object]"

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
    room: Room | None = None
    """The process in which this service stands with others; None for one of its own."""

    @property
    def cells(self) -> tuple[str, ...]:
        """Names of the cells that come into question."""
        return (self.cell,) if self.fleet is None else tuple(str(number + 1) for number in range(self.fleet))


class Service(Asking, Publishing):
    """One service's place in a cell. Use as a context manager; then ``claim``, declare, ``ready`` and ``loop``."""

    def __init__(self, name: str, options: Options, host: Service | None = None) -> None:
        """``host`` is the service whose session and loop this one shares, as its place in another cell of a fleet."""
        super().__init__(Keys(options.cells[0]), Inbox() if host is None else host.inbox)
        # The keys of a fleet's cell are known once it is claimed.
        self.name = name
        self.options = options
        self.log = logging.getLogger(name)
        self.phase = "starting"
        self.run: str | None = None
        self.handled = 0
        self.refused: Counter[str] = Counter()
        self.contract = contract_sha256()
        self._refused_payload = False
        """Since the last heartbeat; it may have been a large one."""
        self._started_ns = time.time_ns()
        self._beat = 0
        self._complained: dict[str, float] = {}
        self._roles: Roles | None = None
        self._places: list[Service] = []
        """In the other cells of a fleet."""
        if host is not None:
            self.session = host.session

    # -- life ----------------------------------------------------------------------------------------------------

    def __enter__(self) -> Service:
        if self.options.room is not None:
            self.session = self.options.room.enter(self.stop)
            return self
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
        if self.options.room is None:
            self.session.close()  # type: ignore[no-untyped-call]
        for place in (self, *self._places):
            if kind is None and place.ousted is not None:
                raise place.ousted

    @property
    def ousted(self) -> RoleTakenError | None:
        """Why this service has to give way to an earlier holder of its role; None as long as it need not."""
        return None if self._roles is None else self._roles.ousted

    def claim(self) -> None:
        """Take this service's role in the cell, or in one of a fleet, waiting as long as others have it.

        Raises CellError when the router takes us for a guest, and ends the process when it is stopped meanwhile.
        """
        self._check_rights()
        cells = [Keys(cell) for cell in self.options.cells]
        self._roles = take_role(self.session, cells, self.name, lambda: self.stopping, self._say_taken)
        if self._roles is None:
            raise SystemExit(0)
        self.keys = self._roles.keys
        self._roles.follow(lambda sample: self.post(self._note_claim, sample))
        self._heartbeat = self.session.declare_publisher(self.keys.heartbeat(self.name), encoding=encoding_of(Alive))
        self.answer(name_of(ALIVE, service=self.name), lambda _: self.status())
        self.inbox.on_beat(self._on_beat)

    def claim_all(self) -> list[Service]:
        """Take this service's role in every cell of a fleet; return its place in each, all served by one loop."""
        self._places = [
            Service(self.name, replace(self.options, cell=cell, fleet=None), self) for cell in self.options.cells
        ]
        for place in self._places:
            place.claim()
        return list(self._places)

    @property
    def place(self) -> int:
        """Number of the cell in its fleet, from 0; 0 without a fleet."""
        return self.options.cells.index(self.keys.cell)

    def ready(self) -> None:
        """Say that the service is alive: it has all it needs and serves its keys."""
        self.phase = "running"
        self._declared.append(self.session.liveliness().declare_token(self.keys.alive(self.name)))
        self.log.info("ready: cell %s, instance %s", self.keys.cell, self._instance)

    @property
    def stopping(self) -> bool:
        """Whether the loop shall end."""
        return self.inbox.stopping

    def loop(self) -> None:
        """Work until stopped."""
        while not self.stopping:
            self.work(1.0)

    def stop(self) -> None:
        """Make the loop end after the event at hand; safe from any thread."""
        self.inbox.stop()

    def work(self, timeout_s: float) -> bool:
        """Do one event of the inbox, waiting at most ``timeout_s`` for it; return whether there was one."""
        return self.inbox.work(timeout_s)

    def work_until(self, done: Callable[[], bool], timeout_s: float, *, heed_quiet: bool = False) -> bool:
        """Work until ``done()``, stop, or the end of ``timeout_s``; return ``done()``. See ``Inbox``."""
        return self.inbox.work_until(done, timeout_s, heed_quiet=heed_quiet)

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

    def ask_experiment(self) -> Experiment | None:
        """Return what the task says that runs, or None, saying loudly why; blocks the loop."""
        try:
            return self.fetch(EXPERIMENT, Experiment)
        except (NoAnswerError, ContractError) as error:
            self.complain(str(error), topic="experiment")
            return None

    # -- what came in --------------------------------------------------------------------------------------------

    def subscribe(
        self, name: str, kind: type[M], handler: Callable[[M], None], *roles: str, quietly: bool = False
    ) -> None:
        """Hand each message on a key to ``handler``, in the loop: with ``roles``, only those of who holds one of them.

        As long as nobody has held any of the roles, everybody is heard. What comes ``quietly`` does not wake the loop.
        """

        def take(sample: zenoh.Sample) -> None:
            self.handled += 1
            message = decode(kind, sample.payload.to_bytes(), str(sample.encoding))
            if self._roles is not None:
                self._roles.check_sender(sample, roles)
            handler(message)

        self.subscribe_raw(name, take, quietly=quietly)

    def check_holder(self, sample: zenoh.Sample, roles: tuple[str, ...]) -> None:
        """Raise StrangerError for a message of anybody but who holds one of the roles at this moment."""
        if self._roles is not None:
            self._roles.check_holder(sample, roles)

    def subscribe_raw(self, name: str, handler: Callable[[zenoh.Sample], None], *, quietly: bool = False) -> None:
        """Hand each sample on a key expression to ``handler``, in the loop."""
        post = self.post_quietly if quietly else self.post
        callback: Handler = Callback(lambda sample: post(handler, sample), indirect=False)
        self._declared.append(self.session.declare_subscriber(self.keys.of(name), callback))

    def watch(self, handler: Callable[[str, bool], None]) -> None:
        """Call ``handler(service, alive)`` in the loop for each service that comes or goes, and those already here."""

        def take(sample: zenoh.Sample) -> None:
            handler(str(sample.key_expr).rpartition("/")[2], sample.kind == zenoh.SampleKind.PUT)

        callback: Handler = Callback(lambda sample: self.post(take, sample), indirect=False)
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

        callback: Handler = Callback(lambda query: self.post(take, query), indirect=False)
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

        callback: Handler = Callback(lambda query: self.post(take, query), indirect=False)
        self._declared.append(self.session.declare_queryable(self.keys.of(name), callback))

    def refuse(self, error: TreenailError) -> None:
        """Count a refusal by the error's name, and log it now and then."""
        name = type(error).__name__
        self.refused[name] += 1
        self._refused_payload |= isinstance(error, BadPayloadError)
        self.complain(f"refused ({self.refused[name]} {name}): {error}", topic=name)

    def complain(self, text: str, topic: str | None = None) -> None:
        """Log a warning, at most once a second for one topic (by default the text itself)."""
        now = self.inbox.now()
        topic = text if topic is None else topic
        if now - self._complained.get(topic, -_COMPLAINT_EVERY_S) >= _COMPLAINT_EVERY_S:
            self._complained[topic] = now
            self.log.warning("%s", one_line(text, 500))

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

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.stop()

    @property
    def _instance(self) -> str:
        return "" if self._roles is None else self._roles.instance

    def _check_rights(self) -> None:
        """Raise CellError when the router takes us for a guest, so that nobody would hear what we say."""
        if self.options.certs is None and self.name not in READERS and Rights(self.session, None).name is not None:
            raise CellError(
                f"router: at {', '.join(self.options.connect)} {self.name} without certificate is a guest, who may "
                "only read: start it as the user and on the machine of the router, or use --certs; see docs/security.md"
            )

    def _say_taken(self, error: RoleTakenError) -> None:
        """Tell who has our role, now and then, while we wait for it."""
        touch_heartbeat()
        self.complain(f"waiting: {error}")

    def _on_beat(self) -> None:
        """Tell the cell, and the container engine, that the loop works."""
        touch_heartbeat()
        self._beat += 1
        if self._roles is not None:
            self._roles.on_beat()
            self._give_way()
        self._heartbeat.put(encode(self.status()))
        if self._refused_payload:
            self._refused_payload = False
            give_back()

    def _note_claim(self, sample: zenoh.Sample) -> None:
        if self._roles is not None:
            self._roles.note(sample)
            self._give_way()

    def _give_way(self) -> None:
        if self.ousted is not None:
            self.stop()
