"""Runs with swaps, without a bus: what is exported, replayed and compared says what really learnt."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from experiments.journal.diff import Comparison
from experiments.journal.replay import Replay
from experiments.lab.in_process import InProcessRun
from experiments.lab.skills import digests, skill_after
from services.rules import skill as skills
from services.rules.results import episodes_digest
from services.rules.skill import SkillError
from services.rules.swaps import planned, words
from services.wire.codec import encode, encoding_of
from services.wire.definition import Definition
from services.wire.definition_file import load
from services.wire.errors import BadPayloadError, GapError
from services.wire.messages import JournalEpisode, Skill, Swap

EPISODES, SEED = 7, 2
SARSA, FUZZY = "3:agent:learner=sarsa", "5:classifier:classifier=fuzzy-art"


class Lived:
    """A run with its journal."""

    def __init__(self, definition: Definition, specs: list[str]) -> None:
        self.swaps: tuple[Swap, ...] = planned("", definition, specs, EPISODES)
        self.run = InProcessRun(definition, SEED, swaps=self.swaps)
        self.journal: list[JournalEpisode] = []
        for _ in self.run.episodes(EPISODES):
            self.journal.append(self.run.task.record())


@pytest.fixture(scope="module")
def definition(small: Path) -> Definition:
    return load(str(small))


@pytest.fixture(scope="module")
def swapped(definition: Definition) -> Lived:
    return Lived(definition, [SARSA, FUZZY])


@pytest.fixture(scope="module")
def plain(definition: Definition) -> Lived:
    return Lived(definition, [])


def test_a_skill_states_what_it_was_learnt_by(swapped: Lived, definition: Definition) -> None:
    learnt = swapped.run.learnt()
    assert learnt.skill.swaps == swapped.swaps
    assert skills.decode(encode(learnt.skill), encoding_of(Skill)) == learnt
    assert digests(learnt.skill)["art2"] == swapped.run.classifier.network.digest()
    assert skill_after(swapped.run.record, EPISODES, {}, swapped.journal, None, swapped.swaps) == learnt
    before = skill_after(swapped.run.record, 5, {}, swapped.journal, None, swapped.swaps)
    assert before.skill.swaps == swapped.swaps[:1], "as it was before the second"
    skills.fits(before.skill, definition)
    with pytest.raises(SkillError, match="expected classifier"):
        skills.fits(learnt.skill, definition)


def test_a_skill_that_hides_a_swap_is_not_sound(swapped: Lived) -> None:
    hidden = replace(swapped.run.learnt().skill, swaps=())
    with pytest.raises(BadPayloadError, match="skill: classifier"):
        skills.decode(encode(hidden), encoding_of(Skill))


def test_the_states_in_the_log_begin_again_with_another_classifier(swapped: Lived, plain: Lived) -> None:
    states = [entry.summary.states for entry in swapped.journal if entry.summary is not None]
    assert states[5] < states[4]
    assert [entry.swaps for entry in swapped.journal] == [0, 0, 0, 1, 1, 2, 2]
    assert [entry.swaps for entry in plain.journal] == [0] * EPISODES


@pytest.mark.parametrize("until", range(1, EPISODES + 1))
def test_a_replay_makes_the_swaps_at_their_episodes(swapped: Lived, definition: Definition, until: int) -> None:
    replay = Replay(swapped.run.record, None, swapped.swaps)
    for entry in swapped.journal[:until]:
        replay.fold(entry)
    assert replay.mismatches == {}
    run = InProcessRun(definition, SEED, swaps=swapped.swaps)
    log = list(run.episodes(until))
    assert replay.digests() == {
        "q_table": run.agent.learner.digest(),
        "art2": run.classifier.network.digest(),
        "episodes": episodes_digest(log),
    }


def test_a_journal_without_its_swaps_is_found_out(swapped: Lived) -> None:
    replay = Replay(swapped.run.record)
    for entry in swapped.journal[:3]:
        replay.fold(entry)
    with pytest.raises(GapError, match="episode 3: swaps: expected 0, got 1"):
        replay.fold(swapped.journal[3])


def test_a_comparison_names_the_swaps(swapped: Lived, plain: Lived) -> None:
    found = Comparison(plain.run.record, swapped.run.record, swaps=(plain.swaps, swapped.swaps))
    assert [(one.field, one.a, one.b) for one in found.settings] == [
        ("swap 1", None, words(swapped.swaps[0])),
        ("swap 2", None, words(swapped.swaps[1])),
    ]
    for pair in zip(plain.journal, swapped.journal, strict=True):
        found.add(*pair)
    assert found.parting is not None and found.parting.episode >= 3
    other = tuple(replace(swap, request="9" * 32) for swap in swapped.swaps)
    assert not Comparison(swapped.run.record, swapped.run.record, swaps=(swapped.swaps, other)).settings
