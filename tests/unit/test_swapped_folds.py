"""Workers' memories with swaps: a function of definition, seed, swaps and steps, whoever brings them and how often."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from services.agent.fold import AgentFold
from services.classifier.fold import ClassifierFold
from services.rules.swaps import in_force, known_in, planned
from services.wire.definition import Definition, Sarsa
from services.wire.errors import DivergedError, GapError
from services.wire.messages import (
    EpisodeSummary,
    JournalEpisode,
    JournalStep,
    Observation,
    Reward,
    Swap,
)

RUN, SEED = "test-s0", 3
BEGUN = Definition(name="test")
DECISIONS = 6
EPISODES = 6
SARSA, RHO, GREEDY = "2:agent:learner=sarsa,alpha=0.2", "3:classifier:rho=0.99", "5:agent:policy=greedy"
PLANS = ([SARSA], [RHO], ["3:classifier:classifier=fuzzy-art"], [SARSA, RHO, GREEDY], [SARSA, "2:agent:policy=greedy"])


def swaps_of(words: Sequence[str]) -> tuple[Swap, ...]:
    return planned(RUN, BEGUN, words, EPISODES)


class Workers:
    """Classifier and agent, one behind the other."""

    def __init__(self, swaps: Sequence[Swap]) -> None:
        self.classifier = ClassifierFold(BEGUN, RUN, swaps)
        self.agent = AgentFold(BEGUN, RUN, SEED, swaps)

    def memory(self) -> tuple[str, str, int]:
        return self.classifier.network.digest(), self.agent.learner.digest(), self.agent.version

    def episode(self, episode: int, swaps: Sequence[Swap]) -> JournalEpisode:
        """Live through an episode, made up, and return its journal."""
        random = np.random.default_rng(episode)
        steps = []
        for number in range(DECISIONS):
            decision = episode * DECISIONS + number
            place: dict[str, Any] = {"run": RUN, "episode": episode, "step": number, "decision": decision}
            place["swaps"] = known_in(swaps, episode)
            force, torque = random.normal(size=(2, 3)).tolist()
            state = self.classifier.observe(Observation(**place, force_n=tuple(force), torque_nm=tuple(torque)))
            action = self.agent.decide(state)
            last = number == DECISIONS - 1
            reward = Reward(**place, reward=float(random.normal()), terminal="inserted" if last else None)
            self.agent.reward(reward)
            steps.append(
                JournalStep(
                    step=number,
                    force_n=tuple(force),
                    torque_nm=tuple(torque),
                    state=state.state,
                    action=action.action,
                    policy_version=action.policy_version,
                    reward=reward.reward,
                )
            )
        summary = EpisodeSummary(
            run=RUN,
            episode=episode,
            episode_return=0.0,
            moves=DECISIONS,
            decisions=DECISIONS,
            mean_force_n=1.0,
            peak_force_n=1.0,
            mean_torque_nm=0.0,
            peak_torque_nm=0.0,
            states=1,
            outcome="inserted",
        )
        return JournalEpisode(
            run=RUN,
            episode=episode,
            first_decision=episode * DECISIONS,
            steps=tuple(steps),
            summary=summary,
            swaps=known_in(swaps, episode),
        )


def lived(swaps: Sequence[Swap], episodes: int = EPISODES) -> tuple[Workers, list[JournalEpisode]]:
    workers = Workers(swaps)
    return workers, [workers.episode(episode, swaps) for episode in range(episodes)]


every_plan = pytest.mark.parametrize("plan", PLANS, ids=lambda plan: "+".join(plan))


@every_plan
def test_replaying_the_journal_gives_the_same_memory(plan: list[str]) -> None:
    swaps = swaps_of(plan)
    workers, journal = lived(swaps)
    assert workers.memory() != lived(())[0].memory()
    again = Workers(swaps)
    for entry in journal:
        again.classifier.replay(entry)
        again.agent.replay(entry)
        again.classifier.replay(entry)  # once more changes nothing
        again.agent.replay(entry)
    assert again.memory() == workers.memory()


@every_plan
@pytest.mark.parametrize("episode", range(1, EPISODES + 1))
def test_from_any_checkpoint_the_later_swaps_are_made_at_their_episodes(plan: list[str], episode: int) -> None:
    swaps = swaps_of(plan)
    workers, journal = lived(swaps)
    before, _ = lived(swaps, episode)
    restored = Workers(swaps)
    for fold, source in ((restored.classifier, before.classifier), (restored.agent, before.agent)):
        fold.restore(source.snapshot())
        for entry in journal[episode:]:
            fold.replay(entry)
        assert fold.timeline.made == known_in(swaps, EPISODES - 1)
    assert restored.memory() == workers.memory()


@every_plan
def test_who_missed_a_swap_notices_before_anything_changes(plan: list[str]) -> None:
    swaps = swaps_of(plan)
    workers, journal = lived(swaps)
    late = Workers(())
    first = swaps[0].episode
    for entry in journal[:first]:
        late.classifier.replay(entry)
        late.agent.replay(entry)
    before = late.memory()
    for fold in (late.classifier, late.agent):
        with pytest.raises(GapError, match="expected to know"):
            fold.replay(journal[first])
    assert late.memory() == before
    for fold in (late.classifier, late.agent):
        fold.timeline.learn_of(swaps)
        for entry in journal[first:]:
            fold.replay(entry)
    assert late.memory() == workers.memory()


def test_q_learning_hands_its_table_to_sarsa() -> None:
    swaps = swaps_of([SARSA])
    workers, _ = lived(swaps, 2)
    q, visits, version = workers.agent.table.q, workers.agent.table.visits, workers.agent.version
    entry = lived(swaps, 3)[1][2]
    workers.agent.replay(replace(entry, steps=(replace(entry.steps[0], reward=None),), summary=None))
    assert workers.agent.timeline.made == 1
    assert workers.agent.timeline.definition.learner == Sarsa(alpha=0.2)
    assert (workers.agent.table.q == q).all() and (workers.agent.table.visits == visits).all()
    assert workers.agent.version == version


def test_another_classifier_starts_both_fresh_and_the_version_never_falls() -> None:
    swaps = swaps_of([RHO])
    workers, _ = lived(swaps, 3)
    assert workers.classifier.network.states > 1
    version = workers.agent.version
    entry = workers.episode(3, swaps)
    versions = [step.policy_version for step in entry.steps]
    assert versions == [version + number for number in range(DECISIONS)]
    assert entry.steps[0].state == 0, "the first class of the new classifier"
    assert int(workers.classifier.network.counts.sum()) == DECISIONS
    assert workers.agent.learner.version == DECISIONS
    assert int(workers.agent.table.visits.sum()) == DECISIONS


def test_other_swaps_than_those_known_are_refused() -> None:
    fold = AgentFold(BEGUN, RUN, SEED, swaps_of([SARSA]))
    with pytest.raises(DivergedError, match="got others"):
        fold.timeline.learn_of(swaps_of([RHO]))
    with pytest.raises(DivergedError, match="got others"):
        fold.timeline.learn_of(())
    _, journal = lived((), 3)
    with pytest.raises(DivergedError, match="in force in episode 2, got 0"):
        for entry in journal:
            fold.replay(entry)


def test_a_checkpoint_with_swaps_that_are_not_known_is_refused() -> None:
    swaps = swaps_of([SARSA, RHO])
    workers, _ = lived(swaps)
    for fold, source in (
        (ClassifierFold(BEGUN, RUN, swaps[:1]), workers.classifier),
        (AgentFold(BEGUN, RUN, SEED, swaps[:1]), workers.agent),
    ):
        with pytest.raises(ValueError, match="expected at most the 1 that are known"):
            fold.restore(source.snapshot())
        assert fold.decisions == 0 and fold.timeline.made == 0


def test_what_is_in_force_is_what_learns() -> None:
    swaps = swaps_of([SARSA, GREEDY])
    assert lived(swaps)[0].agent.timeline.definition == in_force(BEGUN, swaps)
