"""Whole cells as ``treenail up`` brings them up."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import pytest

from services.bus.session import open_client
from services.wire.keys import ACTION, Keys


class Up(Protocol):
    """Starts ``treenail up sim``, or another cell, on free ports."""

    def __call__(self, out: Path, episodes: int, *options: str, seed: int = 1, cell: str = "sim") -> Any:
        """Return the process."""


@pytest.fixture
def up(run_module: Callable[..., Any], small: Path) -> Up:
    def start(out: Path, episodes: int, *options: str, seed: int = 1, cell: str = "sim") -> Any:
        words = ["--experiment", str(small), "--episodes", str(episodes), "--seed", str(seed), "--out", str(out)]
        return run_module("treenail.__main__", "up", cell, *words, "--port", "0", "--no-viewer", *options)

    return start


@pytest.fixture
def endpoint_of(wait_until: Callable[..., None]) -> Callable[[Path], str]:
    """Where the router of a run listens, from its log."""

    def find(out: Path) -> str:
        log = out / "logs" / "router.log"
        wait_until("the router listens", lambda: log.exists() and "listening on" in log.read_text())
        return log.read_text().split("listening on ")[-1].split()[0]

    return find


@pytest.fixture
def after_actions(wait_until: Callable[..., None]) -> Callable[[str, int], None]:
    """Waits until the agent of a cell has acted so often: the moment to disturb it."""

    def wait(endpoint: str, count: int) -> None:
        seen: list[object] = []
        session = open_client([endpoint], 30.0)
        try:
            subscriber = session.declare_subscriber(Keys("a").of(ACTION), seen.append)
            wait_until(f"{count} actions", lambda: len(seen) >= count)
            subscriber.undeclare()  # type: ignore[no-untyped-call]
        finally:
            session.close()  # type: ignore[no-untyped-call]

    return wait


@pytest.fixture
def kill_after(
    after_actions: Callable[[str, int], None], wait_until: Callable[..., None]
) -> Callable[[Any, str, str, int], None]:
    """Kills a child of a running ``treenail up`` by its name, once the agent of its cell has acted so often."""

    def kill(process: Any, endpoint: str, victim: str, actions: int) -> None:
        after_actions(endpoint, actions)
        wait_until(f"{victim} runs", lambda: victim in process.children())
        os.kill(process.children()[victim], signal.SIGKILL)

    return kill


@pytest.fixture
def refused_up(run_module: Callable[..., Any]) -> Callable[..., str]:
    """Runs a ``treenail up`` that is refused, and returns the one line that says why."""

    def refused(*words: str) -> str:
        process = run_module("treenail.__main__", "up", *words)
        assert process.end() == 2
        assert process.err.count("\n") == 1
        return str(process.err)

    return refused


@pytest.fixture
def listed_moves() -> tuple[str, ...]:
    """Overrides for moves on several axes at once, with turns of all three, and one back out."""
    moves = (
        "{name='in',z_mm=0.4},{name='out',z_mm=-0.4},{name='+X',x_mm=0.4},{name='-X',x_mm=-0.4},"
        "{name='aside',x_mm=0.1375,y_mm=-0.2625},{name='+Y',y_mm=0.4},{name='roll',rx_deg=0.3,ry_deg=-0.2,rz_deg=0.15},"
        "{name='screw',y_mm=0.1,z_mm=0.2,rx_deg=-0.3,rz_deg=-0.4}"
    )
    return (f"moves.list=[{moves}]", "limits.hard_force_n=60")
