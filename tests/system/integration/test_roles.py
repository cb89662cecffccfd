"""One process per role and cell: a second one is refused, a successor is welcome."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Any

import pytest

EPISODES = 12


@pytest.mark.parametrize("name", ["task", "sim", "classifier", "agent", "store", "viewer"])
def test_a_second_one_is_refused_and_the_first_goes_on(live: Any, name: str) -> None:
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
    assert second.end() == 2
    (line,) = second.err.splitlines()
    assert line.startswith(f"treenail {name}: {name}: expected to be the only one in cell 'a'")
    assert live.status(name).pid == first.popen.pid
    assert first.err == ""


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
    wait_until("one gives up", lambda: any(process.popen.poll() is not None for process in pair))
    live.wait_alive("agent")
    assert sorted(process.popen.poll() or 0 for process in pair) == [0, 2]
