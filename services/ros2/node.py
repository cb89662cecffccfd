"""A node of ROS 2 on a Zenoh session: its tokens, its publishers and subscribers, and who else is there."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import zenoh
from zenoh.handlers import Callback

from services.ros2 import attachment, names
from services.ros2.attachment import Attachment
from services.ros2.errors import PeerError
from services.ros2.messages import Messages
from services.ros2.names import Endpoint, Qos

USUAL = Qos()
_LOOK_S = 2.0


class Sample(NamedTuple):
    """One sample of a topic, and when it came."""

    key: str
    data: bytes
    attached: bytes | None
    came_ns: int
    """Of the monotonic clock."""


class Node:
    """One node. What it declares is there as long as it is."""

    def __init__(self, session: zenoh.Session, domain: int, name: str, messages: Messages) -> None:
        """Say that it is there. Raises BadNameError."""
        self.domain, self.messages = domain, messages
        self.name = names.checked_node(name)
        self._session, self._zid = session, str(session.zid())
        self._numbers = 0
        self._declared: list[object] = []
        self._declare(names.node_token(domain, self._zid, name))

    def publisher(self, topic: str, kind: str, qos: Qos = USUAL) -> Callable[[bytes], None]:
        """Return a function that publishes a message, in bytes, on a topic. Raises BadNameError.

        Who does not take what is published loses it; nobody is waited for.
        """
        type_hash, key = self._key(topic, kind)
        gid = names.gid(self._endpoint("MP", topic, kind, type_hash, qos))
        publisher = self._session.declare_publisher(
            key,
            encoding="zenoh/bytes",
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.RELIABLE if qos.reliable else zenoh.Reliability.BEST_EFFORT,
        )
        self._declared.append(publisher)
        sent = 0

        def publish(data: bytes) -> None:
            nonlocal sent
            sent += 1
            attached = attachment.written(Attachment(sent, time.time_ns(), gid), self.messages.distribution)
            publisher.put(data, attachment=attached)

        return publish

    def subscribe(self, topic: str, kind: str, take: Callable[[Sample], None], qos: Qos = USUAL) -> None:
        """Have ``take`` called, on Zenoh's thread, with all that comes on a topic, also what is of another type.

        Raises BadNameError.
        """
        type_hash, _ = self._key(topic, kind)
        self._endpoint("MS", topic, kind, type_hash, qos)

        def came(sample: zenoh.Sample) -> None:
            attached = None if sample.attachment is None else sample.attachment.to_bytes()
            take(Sample(str(sample.key_expr), sample.payload.to_bytes(), attached, time.monotonic_ns()))

        callback: Callback[zenoh.Sample] = Callback(came, indirect=False)
        key = names.any_type_key(self.domain, topic)
        self._declared.append(self._session.declare_subscriber(key, callback))

    def read(self, sample: Sample, kind: str) -> Attachment:
        """Return what came with a sample of a type. Raises PeerError for another type, hash or layout."""
        type_name, type_hash = names.type_in(sample.key)
        check_type(kind, type_name, type_hash, self.messages)
        return attachment.read(sample.attached, self.messages.distribution)

    def there(self) -> list[Endpoint]:
        """Return the publishers and subscribers of all that is there; blocks for a moment."""
        replies = self._session.liveliness().get(names.tokens_key(self.domain), timeout=_LOOK_S)
        told = (names.endpoint(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None)
        return sorted(one for one in told if one is not None)

    # -- details -----------------------------------------------------------------------------------------------------

    def _key(self, topic: str, kind: str) -> tuple[str, str]:
        type_hash = self.messages.type_hash(kind)
        return type_hash, names.topic_key(self.domain, names.checked_topic(topic), kind, type_hash)

    def _endpoint(self, what: str, topic: str, kind: str, type_hash: str, qos: Qos) -> str:
        self._numbers += 1
        token = names.endpoint_token(
            self.domain,
            self._zid,
            self.name,
            what,
            self._numbers,
            topic,
            kind,
            type_hash,
            qos.written(self.messages.distribution),
        )
        self._declare(token)
        return token

    def _declare(self, token: str) -> None:
        self._declared.append(self._session.liveliness().declare_token(token))


def check_type(kind: str, type_name: str, type_hash: str, messages: Messages) -> None:
    """Raise PeerError for what is of another type, or of another distribution."""
    ours, name = messages.type_hash(kind), messages.distribution.name
    if type_name != kind:
        raise PeerError(f"type: expected {kind}, got {type_name[:80]}; is it the right topic?")
    if type_hash != ours:
        raise PeerError(
            f"type hash: expected {ours[:15]}... of {kind} as {name} has it, got {type_hash[:24]!r}: a peer of another "
            "distribution, which is not read; see --distribution"
        )


def publishers(there: list[Endpoint], topic: str) -> list[Endpoint]:
    """Return who publishes on a topic."""
    return [one for one in there if one.kind == "MP" and one.topic == topic]


def nobody(there: list[Endpoint], topic: str, kind: str, domain: int) -> str:
    """Return in words that nobody publishes on a topic, and where else something of that type is published."""
    others = sorted({one.topic for one in there if one.kind == "MP" and one.type_name == kind})
    what = kind.rpartition("/")[2]
    hint = f"{what} comes on {', '.join(others[:5])}" if others else f"nobody publishes any {what} there"
    return f"expected a publisher on {topic} in domain {domain}, got none: {hint}"
