"""A room: one process in which several services stand, with one session, and one end.

What one of them publishes or asks and another hears or answers, Zenoh hands over within the process. Each has a thread
for its loop, its inbox, its claim and its keys, as in a process of its own.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Sequence
from types import FrameType, TracebackType

import zenoh

from services.bus.session import open_client


class Room:
    """What services of one process share. As a context manager it has the session; SIGINT and SIGTERM end them all."""

    session: zenoh.Session

    def __init__(self, endpoints: Sequence[str], timeout_s: float) -> None:
        """Nothing is opened yet; the router at one of ``endpoints`` is waited for so long."""
        self._endpoints, self._timeout_s = endpoints, timeout_s
        self._lock = threading.RLock()
        """Entered again by a signal that comes while the main thread has it."""
        self._stops: list[Callable[[], None]] = []
        self.stopping = False

    def __enter__(self) -> Room:
        """Open the session. Raises CellError like ``open_client``."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)
        self.session = open_client(self._endpoints, self._timeout_s, lambda: self.stopping)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.session.close()  # type: ignore[no-untyped-call]

    def enter(self, stop: Callable[[], None]) -> zenoh.Session:
        """Return the session, for a service that ``stop`` ends."""
        with self._lock:
            self._stops.append(stop)
            if self.stopping:
                stop()
        return self.session

    def stop(self) -> None:
        """End all services; safe from any thread."""
        with self._lock:
            self.stopping = True
            for stop in self._stops:
                stop()

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.stop()
