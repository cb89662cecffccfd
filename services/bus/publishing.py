"""What goes out: messages on keys."""

from __future__ import annotations

from collections.abc import Callable
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

    def put(self, key: str, message: Message) -> None:
        """Put a message on a full key, reliably; a put is no proof of storage, only reading it back is."""
        self.session.put(
            key, encode(message), encoding=encoding_of(type(message)), congestion_control=zenoh.CongestionControl.BLOCK
        )
