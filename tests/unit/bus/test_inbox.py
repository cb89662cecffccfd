"""What wakes the loop, and what waits until it is awake."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from services.bus.inbox import Inbox
from services.wire.errors import TreenailError


def refuse(error: TreenailError) -> None:
    raise AssertionError(error)


def noting(into: list[object]) -> Callable[[object], None]:
    return into.append


def test_what_comes_quietly_is_done_before_what_wakes_the_loop() -> None:
    inbox, did = Inbox(), list[object]()
    inbox.post_quietly(noting(did), "sample", refuse)
    inbox.post(noting(did), "answer", refuse)
    assert inbox.work(0.0)
    assert did == ["sample", "answer"]


def test_what_comes_quietly_is_done_at_the_latest_when_the_wait_is_over() -> None:
    inbox, did = Inbox(), list[object]()
    inbox.post_quietly(noting(did), "sample", refuse)
    assert not inbox.work(0.01)
    assert did == ["sample"]


def test_what_came_quietly_before_is_seen_without_waiting() -> None:
    inbox, did = Inbox(), list[object]()
    inbox.post_quietly(noting(did), "sample", refuse)
    began = time.monotonic()
    assert inbox.work_until(lambda: bool(did), 5.0)
    assert time.monotonic() - began < 2.5


def test_who_waits_for_what_comes_quietly_is_woken_by_it() -> None:
    inbox, did = Inbox(), list[object]()
    inbox.work(0.0)  # the first beat
    late = threading.Timer(0.05, lambda: inbox.post_quietly(noting(did), "sample", refuse))
    late.start()
    began = time.monotonic()
    assert inbox.work_until(lambda: bool(did), 30.0, heed_quiet=True)
    assert time.monotonic() - began < 0.9, "sooner than the next heartbeat"
    late.join()


def test_what_a_quiet_event_raises_is_refused() -> None:
    inbox, refused = Inbox(), list[object]()

    def fail(_: object) -> None:
        raise TreenailError("no")

    inbox.post_quietly(fail, None, refused.append)
    inbox.work(0.0)
    assert [str(error) for error in refused] == ["no"]
