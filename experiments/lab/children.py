"""What all who spread work over processes of their own need: quiet starts, Ctrl-C in good order, how a child ended."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnProcess

from services.bus.stop_flag import StopFlag

POLL_S = 0.2
"""How often Ctrl-C is looked for while the children are at work."""
GRACE_S = 1.0
"""How long a child may take to end before it is killed."""


def start(process: SpawnProcess) -> None:
    """Start a child. Raises OSError."""
    # A child starts with the signals blocked that are blocked here. The terminal sends Ctrl-C to children too, and
    # one that is just starting would answer with a traceback. The tracker comes first: its start unblocks SIGINT.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def how_it_ended(process: SpawnProcess) -> str:
    """Wait a moment for a child that is ending, and return its signal or exit status in words."""
    process.join(GRACE_S)
    status = process.exitcode or 0
    return f"signal {-status}" if status < 0 else f"exit status {status}"


@contextmanager
def interrupt_noted() -> Iterator[StopFlag]:
    """Note Ctrl-C and SIGTERM, not end at once, so that no child is lost between being started and being known."""
    noted = StopFlag()
    try:
        yield noted
    finally:
        noted.restore()
