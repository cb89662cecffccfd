"""What it takes to speak on the bus: a session, the keys of a cell, and the inbox of the loop that does the work."""

from __future__ import annotations

from collections.abc import Callable

import zenoh

from services.bus.inbox import Inbox
from services.wire.errors import TreenailError
from services.wire.keys import Keys


class Seat:
    """A place in a cell, from which it is listened, published and asked."""

    session: zenoh.Session

    def __init__(self, keys: Keys, inbox: Inbox) -> None:
        self.keys = keys
        self.inbox = inbox
        self._declared: list[object] = []
        """What Zenoh would give up when nobody refers to it."""

    def refuse(self, error: TreenailError) -> None:
        """Count and tell what came in and does not fit."""
        raise NotImplementedError

    def post(self, handler: Callable[..., None], item: object) -> None:
        """Have the loop call ``handler(item)``; safe from any thread, and never waits."""
        self.inbox.post(handler, item, self.refuse)

    def post_quietly(self, handler: Callable[..., None], item: object) -> None:
        """Have the loop call ``handler(item)`` when something else wakes it; safe from any thread, and never waits."""
        self.inbox.post_quietly(handler, item, self.refuse)
