"""How a run is going: its pace, and how long the rest takes."""

from __future__ import annotations

import time

import pytest

from services.rules.progress import Progress
from services.wire.messages import EpisodeSummary


def summary(episode: int, moves: int = 50) -> EpisodeSummary:
    return EpisodeSummary(
        run="r-s0",
        episode=episode,
        episode_return=-10.0,
        moves=moves,
        decisions=10,
        mean_force_n=0.5,
        peak_force_n=1.0,
        mean_torque_nm=0.1,
        peak_torque_nm=0.2,
        states=4,
        outcome="inserted",
    )


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    return now


def test_the_time_left_is_by_the_pace_of_the_last_episodes(clock: list[float]) -> None:
    run = Progress(200)
    assert run.left_s() is None and "left" not in run.fields()
    for episode in range(11):
        run.add(summary(episode))
        clock[0] += 0.5
    assert run.steps_per_s() == pytest.approx(100.0)
    assert run.left_s() == pytest.approx(189 * 0.5)
    assert run.fields()["left"] == "1 min 34 s"
    assert run.line().endswith("steps/s 100  left 1 min 34 s")


def test_taken_up_again_it_counts_what_is_still_to_do(clock: list[float]) -> None:
    run = Progress(100, done=90)
    for episode in range(90, 100):
        run.add(summary(episode))
        clock[0] += 2.0
    assert run.left_s() == 0.0
    assert run.fields()["left"] == "0 s"


def test_an_episode_that_is_begun_anew_gives_no_pace(clock: list[float]) -> None:
    run = Progress(100)
    run.add(summary(5))
    run.add(summary(5))
    assert run.left_s() is None


@pytest.mark.parametrize(("pace_s", "words"), [(0.2, "20 s"), (3.0, "4 min 57 s"), (100.0, "2 h 45 min")])
def test_it_is_told_in_words(clock: list[float], pace_s: float, words: str) -> None:
    run = Progress(101)
    for episode in range(2):
        run.add(summary(episode))
        clock[0] += pace_s
    assert run.fields()["left"] == words
