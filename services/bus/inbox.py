"""One loop's work: what came in, in order, from whichever thread; and the clock by which the loop waits."""

from __future__ import annotations

import queue
import time
from collections import deque
from collections.abc import Callable
from typing import TypeAlias

from services.bus.thread_state import keep
from services.wire.errors import TreenailError

HEARTBEAT_S = 1.0
"""How often a loop that works says so."""

Event: TypeAlias = tuple[Callable[..., None], object, Callable[[TreenailError], None]]
"""What to call, with what, and who counts the error of ours that it may raise."""


class Inbox:
    """Events for one loop, which does them one at a time; nothing that comes in can stop it."""

    def __init__(self) -> None:
        self.stopping = False
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._quiet: deque[Event] = deque()
        """What is done when something else wakes the loop."""
        self._heeding = False
        """Whether quiet events wake the loop too."""
        self._beats: list[Callable[[], None]] = []
        self._next_beat = self.now()

    def now(self) -> float:
        """Return the time by which this loop waits [s], from an arbitrary start."""
        return time.monotonic()

    def post(self, handler: Callable[..., None], item: object, refuse: Callable[[TreenailError], None]) -> None:
        """Have the loop call ``handler(item)``, and ``refuse`` with its error; safe from any thread, never waits."""
        self._events.put((handler, item, refuse))
        keep()

    def post_quietly(self, handler: Callable[..., None], item: object, refuse: Callable[[TreenailError], None]) -> None:
        """Like ``post``, but the loop need not wake for it alone: it is done before whatever comes next."""
        self._quiet.append((handler, item, refuse))
        if self._heeding:  # looked at after appending, and set before looking: one of the two sees the other
            self.post(_nothing, None, refuse)
        keep()

    def on_beat(self, beat: Callable[[], None]) -> None:
        """Have the loop call ``beat`` every HEARTBEAT_S as long as it works, and at once when it begins."""
        self._beats.append(beat)

    def stop(self) -> None:
        """Make the loop end after the event at hand; safe from any thread and from a signal's handler."""
        self.stopping = True
        self.post(_nothing, None, _nothing)

    def work(self, timeout_s: float) -> bool:
        """Do one event, waiting at most ``timeout_s`` for it; return whether there was one. Beats when it is time."""
        now = self.now()
        if now >= self._next_beat:
            self._next_beat = now + HEARTBEAT_S
            for beat in self._beats:
                beat()
        event = self._take(max(0.0, min(timeout_s, self._next_beat - now)))
        self._do_quiet()
        if event is None:
            return False
        _do(event)
        return True

    def work_until(self, done: Callable[[], bool], timeout_s: float, *, heed_quiet: bool = False) -> bool:
        """Work until ``done()``, stop, or the end of ``timeout_s``; return ``done()``.

        With ``heed_quiet``, what is posted quietly is what is waited for.
        """
        deadline = self.now() + timeout_s
        self._heeding = heed_quiet
        try:
            self._do_quiet()
            while not done():
                left = deadline - self.now()
                if left <= 0 or self.stopping:
                    return done()
                self.work(left)
            return True
        finally:
            self._heeding = False

    def _do_quiet(self) -> None:
        while self._quiet:
            _do(self._quiet.popleft())

    def _take(self, timeout_s: float) -> Event | None:
        """Return the next event, or None when none came within ``timeout_s``."""
        try:
            return self._events.get(timeout=timeout_s)
        except queue.Empty:
            return None


def _do(event: Event) -> None:
    handler, item, refuse = event
    try:
        handler(item)
    except TreenailError as error:
        refuse(error)


def _nothing(_: object) -> None:
    """Wake the loop."""
