"""One process per role and cell: a second one waits until it is needed, a successor is welcome."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Any

import pytest

EPISODES = 12


@pytest.mark.parametrize("name", ["task", "sim", "classifier", "agent", "store", "viewer"])
def test_a_second_one_waits_and_takes_over_when_the_first_is_gone(
    live: Any, wait_until: Callable[..., None], name: str
) -> None:
    extra = {"viewer": ("--bind", "127.0.0.1", "--port", "0")}.get(name, ())
    live.start_loop(500, "task", "sim")
    if name in ("classifier", "agent", "viewer"):
        live.start(name, *extra)
    live.wait_alive(name)
    first = live.processes[name]
    if name == "store":
        second = live.start("store", "--file", str(live.folder / "another.sqlite"))
    elif name == "task":
        live.start_loop(500, "task")
        second = live.processes["task"]
    else:
        second = live.start(name, *extra)
    waiting = f"waiting: {name}: expected to be the only one in cell 'a', but 1 other has this role"
    wait_until("the second says that it waits", lambda: waiting in second.out)
    assert live.status(name).pid == first.popen.pid
    first.popen.kill()
    wait_until("the second takes over", lambda: (now := live.status(name)) and now.pid == second.popen.pid)
    assert first.err == second.err == ""


def test_a_second_store_on_the_same_file_is_refused(live: Any) -> None:
    first = live.processes["store"]
    second = live.start("store", "--cell", "b", "--file", str(live.folder / "store.sqlite"))
    assert second.end() == 2
    (line,) = second.err.splitlines()
    assert "another store has open" in line
    assert live.status("store").pid == first.popen.pid


def test_a_successor_of_one_that_died_goes_on(live: Any, reference: Callable[..., dict[str, str]]) -> None:
    live.start_loop(EPISODES)
    for name in ("agent", "sim", "classifier", "task"):
        live.wait_actions(15)
        live.processes[name].popen.kill()
        live.start_loop(EPISODES, name)
        assert live.processes[name].popen.poll() is None
    assert live.digests() == reference(EPISODES)
    assert all(live.processes[name].stop(signal.SIGTERM) == 0 for name in ("agent", "sim", "classifier", "task"))


def test_two_that_come_at_once_leave_one(live: Any, wait_until: Callable[..., None]) -> None:
    live.start_loop(500, "task")
    pair = [live.start("agent"), live.start("agent")]
    wait_until("one waits", lambda: any("waiting: agent: expected to be" in process.out for process in pair))
    live.wait_alive("agent")
    waiting = next(process for process in pair if "waiting: agent: expected to be" in process.out)
    assert live.status("agent").pid != waiting.popen.pid
    assert waiting.stop(signal.SIGTERM) == 0
