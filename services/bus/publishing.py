"""What goes out: messages on keys."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

import zenoh

from services.bus.seat import Seat
from services.wire.codec import encode, encoding_of
from services.wire.messages import Message

M = TypeVar("M", bound=Message)


class Publishing(Seat):
    """A seat that publishes."""

    def publisher(
        self, name: str, kind: type[M], *, drop: bool = False, with_next: bool = False
    ) -> Callable[[M], None]:
        """Return a function that publishes messages on a key: reliable and blocking, or dropping for telemetry.

        What goes out ``with_next`` may wait, a millisecond at most, for what is sent after it: both are one packet, for
        which everybody on the way wakes once.
        """
        control = zenoh.CongestionControl.DROP if drop else zenoh.CongestionControl.BLOCK
        publisher = self.session.declare_publisher(
            self.keys.of(name), encoding=encoding_of(kind), congestion_control=control, express=not with_next
        )
        self._declared.append(publisher)
        return lambda message: publisher.put(encode(message))

    def series_publisher(self, name: str, kind: type[M]) -> Callable[[Iterable[M]], None]:
        """Return a function that publishes what comes at once: all but the last go with the next.

        Each by itself, those of a process that stood still for a moment would find no room on their way to a hearer,
        who would lose them (decision 3): there is room for 16 packets, whatever is in them.
        """
        publish, publish_with_next = self.publisher(name, kind), self.publisher(name, kind, with_next=True)

        def publish_all(messages: Iterable[M]) -> None:
            held: M | None = None
            try:
                for message in messages:
                    if held is not None:
                        publish_with_next(held)
                    held = message
            finally:
                if held is not None:
                    publish(held)

        return publish_all

    def put(self, key: str, message: Message) -> None:
        """Put a message on a full key, reliably; a put is no proof of storage, only reading it back is."""
        self.session.put(
            key, encode(message), encoding=encoding_of(type(message)), congestion_control=zenoh.CongestionControl.BLOCK
        )
