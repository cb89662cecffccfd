"""Calls that may take long, each on a thread, one after the other, seen from a loop that never waits."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeAlias

from services.bus.opening import Opening
from services.rules.motions import ArmError

CALL_S = 5.0
"""How long one call may take."""
_LAST_S = 1.0
_POLL_S = 0.002

Outcome: TypeAlias = object | ArmError


class Calls:
    """The call under way, if there is any."""

    def __init__(self) -> None:
        self._job: Opening[object] | None = None
        self._by_s = 0.0
        self._then: Callable[[Outcome], None] = ignore

    @property
    def busy(self) -> bool:
        """Whether a call is under way."""
        return self._job is not None

    def start(self, call: Callable[[], object], then: Callable[[Outcome], None]) -> None:
        """Have something done. One that is under way ends first, and what it came to is forgotten."""
        before = self._job

        def after() -> object:
            if before is not None:
                _wait_for(before, CALL_S)
            return call()

        self._job, self._then = Opening(after, ignore), then
        self._by_s = time.monotonic() + CALL_S

    def mind(self, now: float) -> bool:
        """Tell what a call that has ended came to; return False for one that takes too long."""
        job, then = self._job, self._then
        if job is None:
            return True
        if not job.done:
            return now <= self._by_s
        self._job = None
        try:
            result = job.result()
        except ArmError as error:
            then(error)
        else:
            then(result)
        return True

    def forget(self) -> None:
        """Leave the call under way to itself."""
        job, self._job = self._job, None
        if job is not None:
            job.abandon()


def ignore(_: object) -> None:
    """Do nothing with what a call came to."""


def in_time(call: Callable[[], object]) -> None:
    """Do a last thing, and wait for it, but not for long."""
    _wait_for(Opening(call, ignore), _LAST_S)


def _wait_for(job: Opening[object], at_most_s: float) -> None:
    deadline = time.monotonic() + at_most_s
    while not job.done and time.monotonic() < deadline:
        time.sleep(_POLL_S)
