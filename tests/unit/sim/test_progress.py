"""The lines that the simulator prints of a run: as often as a log can bear, and never twice the same."""

from __future__ import annotations

import pytest

from services.sim.progress import Lines
from services.wire.definition import Definition
from services.wire.messages import Alive, EpisodeSummary, Experiment
from tests.unit.heartbeats import alive

RUN = "0123456789abcdef-s1"


def begun() -> Lines:
    experiment = Experiment(
        run=RUN,
        seed=1,
        definition=Definition(name="x"),
        definition_sha256="0" * 64,
        skill_sha256=None,
        first_policy_version=0,
        episodes=30,
        episodes_done=0,
        decisions=0,
        phase="running",
    )
    return Lines("cell 3  ", experiment)


def episode(number: int, run: str = RUN) -> EpisodeSummary:
    return EpisodeSummary(
        run=run,
        episode=number,
        episode_return=-20.0,
        moves=40,
        decisions=10,
        mean_force_n=0.5,
        peak_force_n=1.0,
        mean_torque_nm=0.1,
        peak_torque_nm=0.2,
        states=4,
        outcome="inserted",
    )


def heartbeat(phase: str) -> Alive:
    return alive("task", run=RUN, phase=phase)


def test_what_is_printed_and_when(capsys: pytest.CaptureFixture[str]) -> None:
    lines = begun()
    for number in range(30):
        lines.episode(episode(number), 0.5 * number)
    said = capsys.readouterr().out.splitlines()
    assert said[0] == f"cell 3  run {RUN}: x, seed 1"
    assert [line.split()[3] for line in said[1:]] == ["0/30", *(f"{n}/30" for n in range(1, 30, 4)), "30/30"]
    assert "return(10) -20.0  failures/10 0  force 0.50 N  states 4" in said[-1]


def test_waiting_and_the_end_are_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    lines = begun()
    for second in range(10):
        lines.heartbeat(heartbeat("waiting for agent"), float(second))
        lines.heartbeat(heartbeat("running"), float(second))
    said = capsys.readouterr().out.splitlines()[2:]
    assert said == ["cell 3  episode 0/30  waiting for agent"]
    for number in range(30):
        lines.episode(episode(number), 10.0)
    for second in range(5):
        lines.heartbeat(heartbeat("finished"), 20.0 + second)
    said = capsys.readouterr().out.splitlines()
    assert sum("finished" in line for line in said) == 1


def test_another_run_begins_at_its_own_episode(capsys: pytest.CaptureFixture[str]) -> None:
    lines = begun()
    lines.episode(episode(7), 0.0)
    other = f"{RUN}-k0000000000000000"
    lines.episode(episode(0, other), 5.0)
    said = capsys.readouterr().out.splitlines()
    assert f"cell 3  run {other}" in said
    assert said[-1].startswith("cell 3  episode 1/30")
