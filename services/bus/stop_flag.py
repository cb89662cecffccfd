"""Told to stop by a signal: a flag that any number of signals may set at any moment."""

from __future__ import annotations

import signal
import time

LOOK_EVERY_S = 0.1
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class StopFlag:
    """Set once one of the signals has come.

    It is a plain attribute because a handler runs between any two instructions of the main thread, also inside those of
    ``threading.Event``: a second signal while the first one's handler holds the lock would wait for ever.
    Waiting looks up now and then, because a signal that another thread takes does not wake the main thread.
    """

    def __init__(self, *numbers: signal.Signals) -> None:
        """Handle ``numbers`` (default: SIGINT and SIGTERM). Main thread only."""
        self._set = False
        self._before = {number: signal.signal(number, self._on_signal) for number in numbers or STOP_SIGNALS}

    def __bool__(self) -> bool:
        """Return whether a signal has come."""
        return self._set

    def is_set(self) -> bool:
        """Return whether a signal has come."""
        return self._set

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for a signal, ``timeout_s`` seconds at most; return whether one has come."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while not self._set:
            left = LOOK_EVERY_S if deadline is None else deadline - time.monotonic()
            if left <= 0:
                break
            time.sleep(min(LOOK_EVERY_S, left))
        return self._set

    def restore(self) -> None:
        """Give the signals back to who handled them before."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _on_signal(self, _number: int, _frame: object) -> None:
        self._set = True
