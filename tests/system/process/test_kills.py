"""A cell whose processes are killed, frozen and started again in mid-run ends as one that was left in peace."""

from __future__ import annotations

import os
import random
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

EPISODES = 40
SERVICES = ("router", "store", "task", "sim", "classifier", "agent")


@pytest.fixture
def check(
    up: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    endpoint_of: Callable[[Path], str],
    after_actions: Callable[[str, int], None],
    wait_until: Callable[..., None],
    tmp_path: Path,
) -> Callable[..., str]:
    """Runs a cell, disturbs it, compares how it ends, and returns what it printed."""

    def run(disturb: Callable[[int], None], victims: list[str], seed: int) -> str:
        draw = random.Random(seed)
        out = tmp_path / "A"
        process = up(out, EPISODES)
        endpoint = endpoint_of(out)
        for victim in victims:
            after_actions(endpoint, draw.randrange(1, 160 // len(victims)))
            wait_until(f"{victim} runs", lambda victim=victim: victim in process.children())
            disturb(process.children()[victim])
        assert process.end() == 0, process.err
        assert process.err == ""
        assert digests_in(out) == reference(EPISODES)
        return str(process.out)

    return run


@pytest.mark.parametrize("victim", SERVICES)
def test_a_killed_process_changes_nothing(check: Callable[..., str], victim: str) -> None:
    said = check(lambda pid: os.kill(pid, signal.SIGKILL), [victim], seed=SERVICES.index(victim))
    assert f"{victim} was killed by SIGKILL; starting it again" in said


@pytest.mark.parametrize("seed", [10, 11])
def test_killing_everybody_in_turn_changes_nothing(check: Callable[..., str], seed: int) -> None:
    victims = [*SERVICES, "agent", "classifier"]
    random.Random(seed).shuffle(victims)
    said = check(lambda pid: os.kill(pid, signal.SIGKILL), victims, seed)
    assert said.count("was killed by SIGKILL; starting it again") == len(victims)


def test_a_process_frozen_for_longer_than_its_lease_changes_nothing(
    check: Callable[..., str], wait_until: Callable[..., None]
) -> None:
    def freeze(pid: int) -> None:
        os.kill(pid, signal.SIGSTOP)
        try:
            # Not to wait for something: this is how long it lasts.
            threading.Event().wait(2.0)
        finally:
            os.kill(pid, signal.SIGCONT)

    check(freeze, ["classifier", "sim", "router", "task", "store", "agent"], seed=20)
