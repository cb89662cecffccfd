"""A bus in memory: what a service uses of a Zenoh session, the store behind it, and answers that a test lays out."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, TypeAlias, TypeVar, cast

import zenoh
from zenoh.handlers import Callback

from services.wire.codec import decode, encode, encoding_of
from services.wire.keys import STORED
from services.wire.messages import Complete, Message, Refusal

M = TypeVar("M", bound=Message)
Answer: TypeAlias = "Message | Callable[[FakeQuery], Message | None] | None"
"""What a question gets; None for no answer at all."""


@dataclass
class FakeSample:
    """What a subscriber gets, and what is in a good reply."""

    key_expr: zenoh.KeyExpr
    payload: zenoh.ZBytes
    encoding: zenoh.Encoding
    timestamp: zenoh.Timestamp | None
    kind: zenoh.SampleKind = field(default_factory=lambda: zenoh.SampleKind.PUT)


@dataclass
class FakeError:
    """What is in a reply that refuses."""

    payload: zenoh.ZBytes
    encoding: zenoh.Encoding


@dataclass
class FakeReply:
    """A sample, or an error."""

    ok: FakeSample | None = None
    err: FakeError | None = None


class FakeQuery:
    """A question, and what has been answered to it; ``final`` when nothing more will come."""

    def __init__(self, selector: str, payload: bytes | None = None, encoding: str | None = None) -> None:
        key, _, parameters = selector.partition("?")
        self.key_expr = zenoh.KeyExpr(key)
        self.parameters = parameters
        self.payload = None if payload is None else zenoh.ZBytes(payload)
        self.encoding = None if encoding is None else zenoh.Encoding(encoding)
        self.replies: list[FakeReply] = []
        self.final = False

    def reply(self, key: str, payload: bytes, *, encoding: str, **qos: Any) -> None:
        """Answer."""
        sample = FakeSample(zenoh.KeyExpr(key), zenoh.ZBytes(payload), zenoh.Encoding(encoding), qos.get("timestamp"))
        self.replies.append(FakeReply(ok=sample))

    def reply_err(self, payload: bytes, *, encoding: str) -> None:
        """Refuse."""
        self.replies.append(FakeReply(err=FakeError(zenoh.ZBytes(payload), zenoh.Encoding(encoding))))

    def __enter__(self) -> FakeQuery:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.final = True

    def message(self, kind: type[M]) -> M:
        """Return what came with the question."""
        assert self.payload is not None
        return decode(kind, self.payload.to_bytes(), str(self.encoding))


class FakeBus:
    """The router and all the others: what was published, what the store has, and what they answer."""

    def __init__(self) -> None:
        self.answers: dict[str, Answer] = {}
        """By a key's name, without the cell: what others answer to questions of ours."""
        self.published: list[tuple[str, bytes, str]] = []
        """All that was put: key, payload, encoding."""
        self.stored: dict[str, FakeSample] = {}
        """What the store has, by key: all that was put under ``journal/`` and ``checkpoint/``."""
        self.store_answers = True
        """Whether the store is there; it loses what is put meanwhile."""
        self.asked: list[FakeQuery] = []
        """All questions that were asked."""
        self.subscribers: list[tuple[zenoh.KeyExpr, Callable[[FakeSample], None]]] = []
        self.watchers: list[tuple[zenoh.KeyExpr, Callable[[FakeSample], None]]] = []
        self.queryables: list[tuple[zenoh.KeyExpr, Callable[[FakeQuery], None]]] = []
        self.tokens: set[str] = set()
        self._ticks = 1_000_000

    def timestamp(self, session: str) -> zenoh.Timestamp:
        """Return a timestamp of a session, later than all before it."""
        self._ticks += 1
        name = bytes.fromhex(session.zfill(len(session) + len(session) % 2))
        return zenoh.Timestamp(zenoh.NTP64(self._ticks, 0), name[::-1])

    def put(self, sample: FakeSample) -> None:
        """Give a sample to all who listen, and to the store what is the store's."""
        key, payload = str(sample.key_expr), sample.payload.to_bytes()
        self.published.append((key, payload, str(sample.encoding)))
        if self.store_answers and key.split("/")[2] in ("journal", "checkpoint"):
            self.stored[key] = sample
        for wanted, take in self.subscribers:
            if wanted.intersects(sample.key_expr):
                take(sample)

    def on(self, key: str, kind: type[M], handler: Callable[[M], object]) -> None:
        """Call ``handler`` with each message on a key, as another process would hear it."""

        def take(sample: FakeSample) -> None:
            handler(decode(kind, sample.payload.to_bytes(), str(sample.encoding)))

        self.subscribers.append((zenoh.KeyExpr(key), take))

    def forget_others(self) -> None:
        """Let all who listen and answer be gone; what the store has stays."""
        self.subscribers.clear()
        self.watchers.clear()
        self.queryables.clear()

    def token(self, key: str, here: bool) -> None:
        """Let a liveliness token come or go."""
        if here == (key in self.tokens):
            return
        (self.tokens.add if here else self.tokens.discard)(key)
        kind = zenoh.SampleKind.PUT if here else zenoh.SampleKind.DELETE
        for wanted, take in self.watchers:
            if wanted.intersects(zenoh.KeyExpr(key)):
                take(_token(key, kind))

    def reply(self, query: FakeQuery) -> list[FakeReply]:
        """Return what a question gets: from the store, from a test's answers, or from a service on this bus."""
        self.asked.append(query)
        name = str(query.key_expr).split("/", 2)[2]
        if any(name.startswith(stored.removesuffix("**")) for stored in STORED):
            values = [
                FakeReply(sample) for sample in self.stored.values() if query.key_expr.intersects(sample.key_expr)
            ]
            if "complete" in query.parameters:
                query.reply_err(encode(Complete(values=len(values))), encoding=encoding_of(Complete))
            return [*values, *query.replies] if self.store_answers else []
        answer = self.answers.get(name)
        if callable(answer):
            answer = answer(query)
        if isinstance(answer, Refusal):
            query.reply_err(encode(answer), encoding=encoding_of(Refusal))
        elif answer is not None:
            query.reply(str(query.key_expr), encode(answer), encoding=encoding_of(type(answer)))
        return query.replies


class FakeSession:
    """What a service uses of ``zenoh.Session``."""

    def __init__(self, bus: FakeBus, zid: str) -> None:
        self._bus, self._zid = bus, zid

    def zid(self) -> str:
        """Return the session's name."""
        return self._zid

    def close(self) -> None:
        """Do nothing: a test looks at the bus afterwards."""

    def new_timestamp(self) -> zenoh.Timestamp:
        """Return a timestamp of this session."""
        return self._bus.timestamp(self._zid)

    def put(self, key: object, payload: bytes | zenoh.ZBytes, *, encoding: object, **qos: Any) -> None:
        """Put a value."""
        stamp = qos.get("timestamp") or self.new_timestamp()
        value = zenoh.ZBytes(payload) if isinstance(payload, bytes) else payload
        self._bus.put(FakeSample(zenoh.KeyExpr(str(key)), value, zenoh.Encoding(str(encoding)), stamp))

    def declare_publisher(self, key: str, *, encoding: str, **_qos: Any) -> FakePublisher:
        """Return where to put the values of one key."""
        return FakePublisher(self, key, encoding)

    def declare_subscriber(self, key: str, handler: Any) -> FakeChannel:
        """Listen: with a callback, or with a channel to read from."""
        channel = FakeChannel()
        take = handler if isinstance(handler, Callback) else channel.items.append
        self._bus.subscribers.append((zenoh.KeyExpr(key), cast("Callable[[FakeSample], None]", take)))
        return channel

    def declare_queryable(self, key: str, handler: Callable[[FakeQuery], None]) -> object:
        """Answer."""
        self._bus.queryables.append((zenoh.KeyExpr(key), handler))
        return handler

    def declare_querier(self, key: str, **_qos: Any) -> FakeQuerier:
        """Return with what to ask one key."""
        return FakeQuerier(self, key)

    def get(self, selector: object, handler: Any = None, **more: Any) -> Any:
        """Ask: returns the replies, or a channel of them, or gives them to a callback."""
        replies = self._bus.reply(FakeQuery(str(selector), more.get("payload"), more.get("encoding")))
        if handler is None:
            return iter(replies)
        if not isinstance(handler, Callback):
            return FakeChannel(deque(replies), closed=True)
        for reply in replies:
            handler(cast("zenoh.Reply", reply))
        if handler.drop is not None:
            handler.drop()
        return None

    def liveliness(self) -> FakeLiveliness:
        """Return who is here."""
        return FakeLiveliness(self._bus)


@dataclass
class FakeChannel:
    """What came to a subscription, or as replies, and was not read yet."""

    items: deque[Any] = field(default_factory=deque)
    closed: bool = False

    def try_recv(self) -> Any:
        """Return the next one; without one None, or ZError when none will come."""
        if not self.items and self.closed:
            raise zenoh.ZError("closed")
        return self.items.popleft() if self.items else None


@dataclass
class FakePublisher:
    """Puts on one key."""

    session: FakeSession
    key: str
    encoding: str

    def put(self, payload: bytes) -> None:
        """Put a value."""
        self.session.put(self.key, payload, encoding=self.encoding)


@dataclass
class FakeQuerier:
    """Asks one key."""

    session: FakeSession
    key: str

    def get(
        self, *, handler: Any, parameters: str = "", payload: bytes | None = None, encoding: str | None = None
    ) -> None:
        """Ask."""
        selector = f"{self.key}?{parameters}" if parameters else self.key
        self.session.get(selector, handler, payload=payload, encoding=encoding)


@dataclass
class FakeToken:
    """A liveliness token."""

    bus: FakeBus
    key: str

    def undeclare(self) -> None:
        """Let it go."""
        self.bus.token(self.key, here=False)


@dataclass
class FakeLiveliness:
    """Who is here."""

    bus: FakeBus

    def declare_token(self, key: str) -> FakeToken:
        """Be here."""
        self.bus.token(key, here=True)
        return FakeToken(self.bus, key)

    def declare_subscriber(self, key: str, handler: Callable[[FakeSample], None], *, history: bool) -> object:
        """See who comes and goes, and with ``history`` who is here."""
        self.bus.watchers.append((zenoh.KeyExpr(key), handler))
        for token in sorted(self.bus.tokens) if history else ():
            if zenoh.KeyExpr(key).intersects(zenoh.KeyExpr(token)):
                handler(_token(token, zenoh.SampleKind.PUT))
        return handler

    def get(self, key: str, **_qos: Any) -> Iterator[FakeReply]:
        """Return who is here."""
        here = [token for token in sorted(self.bus.tokens) if zenoh.KeyExpr(key).intersects(zenoh.KeyExpr(token))]
        return iter([FakeReply(ok=_token(token, zenoh.SampleKind.PUT)) for token in here])


def _token(key: str, kind: zenoh.SampleKind) -> FakeSample:
    return FakeSample(zenoh.KeyExpr(key), zenoh.ZBytes(b""), zenoh.Encoding("zenoh/bytes"), None, kind)
