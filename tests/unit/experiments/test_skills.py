"""What was learnt, taken out of a run at any episode and put into another."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from experiments.lab.in_process import InProcessRun
from experiments.lab.skills import digests, skill_after
from services.agent.fold import AgentFold
from services.classifier.fold import ClassifierFold
from services.rules import skill as skills
from services.rules.skill import NamedSkill
from services.wire.codec import encode, encoding_of
from services.wire.definition import Definition
from services.wire.definition_file import load, run_id
from services.wire.errors import DivergedError, TreenailError
from services.wire.messages import Checkpoint, JournalEpisode, Skill

EPISODES = 7
SEED = 5


class Recorded:
    """A run in this process with all that its cell's store would have, and what it had learnt after each episode."""

    def __init__(self, definition: Definition, began_with: NamedSkill | None = None) -> None:
        self.run = InProcessRun(definition, SEED, skill=began_with)
        self.journal: list[JournalEpisode] = []
        self.learnt = [self.run.learnt()]
        self.checkpoints: list[dict[str, Checkpoint]] = [self._checkpoints()]
        for _ in self.run.episodes(EPISODES):
            self.journal.append(self.run.task.record())
            self.learnt.append(self.run.learnt())
            self.checkpoints.append(self._checkpoints())

    def _checkpoints(self) -> dict[str, Checkpoint]:
        folds: Mapping[str, AgentFold | ClassifierFold] = {"agent": self.run.agent, "classifier": self.run.classifier}
        return {
            service: Checkpoint(
                run=self.run.run,
                service=service,
                episode=self.run.episodes_done,
                decisions=fold.decisions,
                contract_sha256=self.run.record.contract_sha256,
                snapshot=fold.snapshot(),
            )
            for service, fold in folds.items()
        }


@pytest.fixture(scope="module")
def definition(small: Path) -> Definition:
    return load(str(small))


@pytest.fixture(scope="module")
def first(definition: Definition) -> Recorded:
    """A run that began with nothing."""
    return Recorded(definition)


@pytest.fixture(scope="module")
def second(definition: Definition, first: Recorded) -> Recorded:
    """A run that began with what the first had learnt."""
    return Recorded(definition, first.learnt[-1])


def test_memory_at_any_episode_from_any_checkpoint_is_exact(first: Recorded, second: Recorded) -> None:
    assert len({skill.sha256 for skill in first.learnt}) > 4, "a run that learns nothing proves nothing"
    for recorded, began_with in ((first, None), (second, first.learnt[-1])):
        for episode in range(EPISODES + 1):
            for start in range(episode + 1):
                checkpoints = recorded.checkpoints[start] if start else {}
                journal = recorded.journal[start:]
                found = skill_after(recorded.run.record, episode, checkpoints, journal, began_with)
                assert found == recorded.learnt[episode]


def test_agent_and_classifier_may_stand_at_different_checkpoints(first: Recorded) -> None:
    starts = {"agent": first.checkpoints[5]["agent"], "classifier": first.checkpoints[2]["classifier"]}
    assert skill_after(first.run.record, 6, starts, first.journal[2:], None) == first.learnt[6]
    assert skill_after(first.run.record, 6, {"agent": starts["agent"]}, first.journal, None) == first.learnt[6]


def test_missing_episodes_are_named(first: Recorded) -> None:
    with pytest.raises(TreenailError, match="expected episode 3 in the journal, got none"):
        skill_after(first.run.record, 6, {}, first.journal[:3] + first.journal[4:], None)
    with pytest.raises(TreenailError, match="expected episode 0"):
        skill_after(first.run.record, 6, {"agent": first.checkpoints[2]["agent"]}, first.journal[2:], None)


def test_memory_needs_the_skill_that_the_run_began_with(first: Recorded, second: Recorded) -> None:
    with pytest.raises(DivergedError, match="to begin with, got None"):
        skill_after(second.run.record, 2, {}, second.journal, None)
    with pytest.raises(DivergedError, match="expected skill None to begin with"):
        skill_after(first.run.record, 2, {}, first.journal, first.learnt[-1])


def test_skill_transfers_to_the_last_bit(definition: Definition, first: Recorded) -> None:
    learnt = first.learnt[-1]
    other = InProcessRun(definition, SEED + 1, skill=learnt)
    assert other.run == run_id(definition, SEED + 1, learnt.sha256) != run_id(definition, SEED + 1)
    assert other.agent.learner.digest() == first.run.agent.learner.digest() == digests(learnt.skill)["q_table"]
    assert other.classifier.network.digest() == first.run.classifier.network.digest() == digests(learnt.skill)["art2"]
    assert other.agent.decisions == other.classifier.decisions == 0
    assert learnt.version == other.agent.version == first.run.agent.learner.version
    assert first.run.agent.version == first.run.decisions >= learnt.version, "an end by the move limit teaches nothing"
    assert learnt.states == other.classifier.network.states


def test_policy_goes_on_where_the_skill_left_it(definition: Definition, first: Recorded) -> None:
    learnt = first.learnt[-1]
    assert learnt.skill.episodes == EPISODES
    other = InProcessRun(definition, SEED, skill=learnt)
    differ = 0
    for state in range(learnt.states):
        later, now = first.run.agent.table.chances(state, EPISODES), other.agent.table.chances(state, 0)
        assert np.array_equal(later, now)
        differ += not np.array_equal(now, first.run.agent.table.chances(state, 0))
    assert differ, "a schedule that does not move proves nothing"


def test_skills_of_skills_count_all_episodes(second: Recorded, first: Recorded) -> None:
    assert [skill.skill.episodes for skill in second.learnt] == list(range(EPISODES, 2 * EPISODES + 1))
    assert {skill.skill.skill_sha256 for skill in second.learnt} == {first.learnt[-1].sha256}
    assert second.learnt[-1].version == second.run.agent.learner.version > first.learnt[-1].version
    assert second.run.agent.version == first.learnt[-1].version + second.run.decisions
    assert second.learnt[0].skill.agent == first.learnt[-1].skill.agent


def test_summary_counts_states_that_were_brought_along(first: Recorded, second: Recorded) -> None:
    summary = second.journal[0].summary
    assert summary is not None
    assert summary.states >= first.learnt[-1].states > 3


NUMBERS = st.integers(-2, 20) | st.integers(2**52, 2**62)
VALUES = NUMBERS | st.binary(max_size=24) | st.sampled_from([0.0, -0.0, 1e300, float("inf"), float("nan"), -1.0])


@given(
    whose=st.sampled_from(["agent", "classifier"]),
    name=st.sampled_from(["actions", "states", "version", "q", "visits", "inputs", "weights", "counts", "more"]),
    place=st.integers(0, 2**16),
    value=VALUES,
)
def test_whatever_is_taken_for_sound_can_be_loaded(
    first: Recorded, whose: str, name: str, place: int, value: int | bytes | float
) -> None:
    """Who passes a skill on must not let through what would leave the workers of a cell without a memory."""
    skill = first.learnt[-1].skill
    memory: dict[str, bytes | int] = dict(getattr(skill, whose))
    old = memory.get(name)
    if isinstance(value, float):  # one number of a block
        if not isinstance(old, bytes) or not old:
            return
        start = place % (len(old) // 8) * 8
        memory[name] = old[:start] + np.array([value], "<f8").tobytes() + old[start + 8 :]
    else:
        memory[name] = value
    changed = replace(skill, **{whose: memory})
    try:
        found = skills.decode(encode(changed), encoding_of(Skill))
    except TreenailError:
        assert changed != skill
        return
    agent, classifier = AgentFold(skill.definition, "test-s0", SEED), ClassifierFold(skill.definition, "test-s0")
    agent.begin_with(found.skill)
    classifier.begin_with(found.skill)
    assert agent.learner.states <= classifier.network.states
