"""A noisy sensor under a heavy tool: distributed and in one process the same; what cannot be a zero stops all."""

from __future__ import annotations

import pytest

from experiments.lab.in_process import InProcessRun
from services.rules.motions import GuardError
from services.task.service import work
from services.wire.definition import Definition
from services.wire.definition_file import load
from services.wire.errors import DefinitionError
from services.wire.messages import EpisodeSummary, JournalEpisode, Observation
from tests.unit.shells.test_task_and_sim_shells import kill_simulator, run_task

SEED, EPISODES = 1, 2


@pytest.fixture(scope="module")
def heavy() -> Definition:
    return load("suite-heavy-tool")


@pytest.fixture(scope="module")
def expected(heavy: Definition) -> tuple[list[EpisodeSummary], list[JournalEpisode]]:
    run = InProcessRun(heavy, SEED)
    summaries, entries = [], []
    for summary in run.episodes(EPISODES):
        summaries.append(summary)
        entries.append(run.task.record())
    return summaries, entries


def test_a_run_with_zeros_is_the_one_in_a_process_and_they_are_in_its_journal(
    heavy: Definition, expected: tuple[list[EpisodeSummary], list[JournalEpisode]]
) -> None:
    task, _ = run_task(heavy)
    task.run_for(lambda service: work(service, heavy, SEED, EPISODES), 60.0)
    assert task.published(EpisodeSummary) == expected[0]
    entries = task.published(JournalEpisode)[::2]  # each is put twice: as itself and as the newest
    assert entries == expected[1]
    for entry in entries:
        (zero,) = entry.zeros
        assert zero.step == 0
        assert zero.sigma_n == pytest.approx(1.0, rel=0.2)
        assert all(abs(value) < 3.0 for value in zero.force_n), "without the weight"
    assert entries[0].zeros != entries[1].zeros, "it wanders"


def test_a_simulator_that_is_killed_within_an_episode_comes_back_to_the_same_zero(
    heavy: Definition, expected: tuple[list[EpisodeSummary], list[JournalEpisode]]
) -> None:
    task, others = run_task(heavy)
    killed = kill_simulator(others, heavy, SEED)
    task.run_for(lambda service: work(service, heavy, SEED, EPISODES), 60.0)
    assert killed == [0, 1]
    assert task.published(EpisodeSummary) == expected[0]
    assert task.published(JournalEpisode)[::2] == expected[1]


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        (("tool.mass_kg=1.5",), "is the tool 1.02 kg heavier than calibrated, or pressed on something?"),
        (("noise.force_n=3",), "tare: expected noise of at most 2 times the 1 N of the calibration, got"),
        (("drift.offset_n=20",), "is the tool in the air, and the sensor the one that was calibrated?"),
    ],
)
def test_what_cannot_be_a_zero_stops_all_before_anything_is_learnt(settings: tuple[str, ...], why: str) -> None:
    wrong = load("suite-heavy-tool", (*settings, "limits.hard_force_n=60"))
    with pytest.raises(GuardError) as caught:
        next(InProcessRun(wrong, SEED).episodes(1))
    assert why in str(caught.value)
    task, _ = run_task(wrong)
    task.run_for(lambda service: work(service, wrong, SEED, 1), 20.0)
    assert task.phase.startswith("stopped: guard: tare: expected ")
    assert task.published(Observation) == []
    assert task.published(EpisodeSummary) == []


def test_without_a_calibration_there_is_no_run() -> None:
    with pytest.raises(DefinitionError, match=r"sensor\.tare_samples: expected 0 without a calibration .*got 256"):
        load("suite-heavy-tool", ("calibration.sigma_n=0",))


def test_a_zero_that_jumps_from_one_episode_to_the_next_stops_the_run(heavy: Definition) -> None:
    """As of a sensor that was switched off and on: the first episode is learnt from, the next is not begun."""
    jumping = load("suite-heavy-tool", ("drift.walk_n=1.5",))
    run = InProcessRun(jumping, SEED)
    episodes = run.episodes(20)
    next(episodes)
    done = run.learnt().sha256
    with pytest.raises(GuardError, match="of that of the tare before"):
        next(episodes)
    assert run.learnt().sha256 == done
