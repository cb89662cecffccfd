"""The classifier's memory: a function of the observations, whoever brings them and how often."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from msgspec.structs import replace

from services.classifier.fold import ClassifierFold
from services.wire.codec import decode_payload, encode
from services.wire.definition import Art2Settings, Definition
from services.wire.errors import DivergedError, ForeignRunError, GapError, TreenailError
from services.wire.messages import EpisodeSummary, JournalEpisode, JournalStep, Observation

RUN = "test-s0"
DEFINITION = Definition(name="test")
EPISODES = (4, 1, 7, 3, 0, 5)
"""Decisions in each episode of the synthetic run."""


def observations() -> list[Observation]:
    """Return a run's observations with made-up samples, some of them repeated."""
    random = np.random.default_rng(11)
    prototypes = random.normal(size=(4, 6))
    made: list[Observation] = []
    for episode, count in enumerate(EPISODES):
        for number in range(count):
            fx, fy, fz, tx, ty, tz = (random.choice(prototypes) * 2 + random.normal(scale=0.3, size=6)).tolist()
            made.append(
                Observation(
                    run=RUN,
                    episode=episode,
                    step=3 + 2 * number,
                    decision=len(made),
                    force_n=(fx, fy, fz),
                    torque_nm=(tx / 10, ty / 10, tz / 10),
                )
            )
    return made


def journal(seen: list[Observation], states: list[int | None] | None = None) -> list[JournalEpisode]:
    """Return the journal that the task would keep of these observations."""
    entries = []
    for episode in range(len(EPISODES)):
        mine = [observation for observation in seen if observation.episode == episode]
        steps = tuple(
            JournalStep(
                step=one.step,
                force_n=one.force_n,
                torque_nm=one.torque_nm,
                state=None if states is None else states[one.decision],
            )
            for one in mine
        )
        first = sum(EPISODES[:episode])
        entries.append(
            JournalEpisode(run=RUN, episode=episode, first_decision=first, steps=steps, summary=summary(episode, steps))
        )
    return entries


def summary(episode: int, steps: tuple[JournalStep, ...]) -> EpisodeSummary:
    return EpisodeSummary(
        run=RUN,
        episode=episode,
        episode_return=0.0,
        moves=20,
        decisions=len(steps),
        mean_force_n=1.0,
        peak_force_n=2.0,
        mean_torque_nm=0.0,
        peak_torque_nm=0.0,
        states=0,
        outcome="inserted",
    )


SEEN = observations()


def fresh() -> ClassifierFold:
    return ClassifierFold(DEFINITION, RUN)


def after(count: int) -> ClassifierFold:
    """Return the fold of the first ``count`` observations."""
    fold = fresh()
    for observation in SEEN[:count]:
        fold.observe(observation)
    return fold


def memory(fold: ClassifierFold) -> tuple[str, int, int]:
    return fold.network.digest(), fold.decisions, fold.episode


def test_the_synthetic_run_is_worth_testing_with() -> None:
    fold = after(len(SEEN))
    assert 2 <= fold.network.states < len(SEEN)
    assert fold.decisions == len(SEEN) == sum(EPISODES)


def test_the_answer_names_its_observation() -> None:
    fold = fresh()
    for observation in SEEN:
        state = fold.observe(observation)
        assert (state.run, state.episode, state.step, state.decision) == (
            RUN,
            observation.episode,
            observation.step,
            observation.decision,
        )
        assert 0 <= state.state < state.states == fold.network.states


def test_the_same_observation_again_gets_the_same_answer_and_is_not_learnt() -> None:
    fold = fresh()
    for observation in SEEN:
        answer = fold.observe(observation)
        before = memory(fold)
        for earlier in SEEN[: observation.decision + 1]:
            if earlier.episode == observation.episode:
                again = fold.observe(earlier)
                assert earlier is not observation or again == answer
        assert memory(fold) == before
    assert memory(fold) == memory(after(len(SEEN)))


def refused(fold: ClassifierFold, act: Callable[[], object], error: type[Exception]) -> None:
    """Check that something is refused, changes nothing, and does not stand in the way of what comes next."""
    before, snapshot = memory(fold), fold.snapshot()
    with pytest.raises(error):
        act()
    assert memory(fold) == before
    assert fold.snapshot() == snapshot
    if fold.decisions < len(SEEN):
        fold.observe(SEEN[fold.decisions])
        assert memory(fold) == memory(after(fold.decisions))


def test_a_gap_is_refused() -> None:
    for count in range(sum(EPISODES)):
        for ahead in (1, 2):
            if count + ahead < len(SEEN):
                fold = after(count)
                refused(fold, partial(fold.observe, SEEN[count + ahead]), GapError)


def test_another_run_is_refused() -> None:
    fold = after(3)
    refused(fold, lambda: fold.observe(replace(SEEN[3], run="other-s0")), ForeignRunError)
    fold = after(3)
    entry = replace(journal(SEEN)[0], run="other-s0")
    refused(fold, lambda: fold.replay(entry), ForeignRunError)


def test_the_same_decision_with_another_sample_is_refused() -> None:
    for change in ({"force_n": (1.0, 2.0, 3.0)}, {"torque_nm": (0.0, 0.0, 0.0)}, {"step": 77}):
        fold = after(3)
        refused(fold, partial(fold.observe, replace(SEEN[2], **change)), DivergedError)


def test_an_earlier_episode_is_refused() -> None:
    fold = after(EPISODES[0] + EPISODES[1])
    refused(fold, lambda: fold.observe(SEEN[0]), DivergedError)
    fold = after(7)
    refused(fold, lambda: fold.observe(replace(SEEN[7], episode=1)), DivergedError)


def test_a_sample_without_a_direction_is_refused_like_anything_else() -> None:
    """A stray publisher may send it: it must neither end the classifier nor make it forget its answers."""
    fold = after(EPISODES[0])
    nothing = encode(replace(SEEN[EPISODES[0]], force_n=(0.0, 0.0, 0.0), torque_nm=(0.0, 0.0, 0.0)))
    refused(fold, lambda: fold.observe(decode_payload(Observation, nothing)), TreenailError)


def test_a_full_classifier_that_refuses_does_it_like_anything_else() -> None:
    settings = Art2Settings(capacity=1, when_full="refuse")
    fold = ClassifierFold(Definition(name="full", classifier=settings), RUN)
    fold.observe(SEEN[0])
    with pytest.raises(TreenailError):
        for observation in SEEN[1:]:
            fold.observe(observation)


def test_replay_of_a_journal_is_the_run() -> None:
    live = after(len(SEEN))
    states: list[int | None] = []
    witness = fresh()
    for observation in SEEN:
        states.append(witness.observe(observation).state)
    for known in (None, states):
        fold = fresh()
        for entry in journal(SEEN, known):
            fold.replay(entry)
        assert memory(fold) == memory(live)
        assert fold.snapshot() == live.snapshot()


def test_replay_takes_only_what_is_new() -> None:
    entries = journal(SEEN)
    for count in range(len(SEEN)):
        fold = after(count)
        for entry in entries:
            fold.replay(entry)
            fold.replay(entry)
        assert memory(fold) == memory(after(len(SEEN)))


def test_replay_of_a_later_entry_is_a_gap() -> None:
    fold = after(2)
    refused(fold, lambda: fold.replay(journal(SEEN)[2]), GapError)


def test_replay_with_another_state_is_refused() -> None:
    wrong = journal(SEEN, [9] * len(SEEN))[0]
    with pytest.raises(DivergedError, match="journal has state 9"):
        fresh().replay(wrong)


@pytest.mark.parametrize("episode", range(len(EPISODES) + 1))
def test_a_checkpoint_and_the_rest_is_the_whole_run(episode: int) -> None:
    count = sum(EPISODES[:episode])
    snapshot = after(count).snapshot()
    live, by_journal = fresh(), fresh()
    live.restore(snapshot)
    by_journal.restore(snapshot)
    assert memory(live) == memory(after(count))
    for observation in SEEN[count:]:
        live.observe(observation)
    for entry in journal(SEEN)[episode // 2 :]:
        by_journal.replay(entry)
    assert live.snapshot() == by_journal.snapshot() == after(len(SEEN)).snapshot()


def test_a_restart_in_mid_episode_goes_on_by_the_partial_record() -> None:
    for count in range(1, sum(EPISODES)):
        episode = SEEN[count - 1].episode
        boundary = sum(EPISODES[:episode])
        fold = fresh()
        fold.restore(after(boundary).snapshot())
        entry = journal(SEEN)[episode]
        fold.replay(replace(entry, steps=entry.steps[: count - boundary], summary=None))
        assert memory(fold) == memory(after(count))
        assert fold.observe(SEEN[count - 1]) == after(count - 1).observe(SEEN[count - 1])
        for observation in SEEN[count:]:
            fold.observe(observation)
        assert memory(fold) == memory(after(len(SEEN)))


@pytest.mark.parametrize(
    "change",
    [
        {"fold_decisions": b"1"},
        {"fold_episode": None},
        {"fold_decisions": -1},
        {"fold_swaps": 1},
        {"weights": b""},
        {"states": 10**9},
        {"unknown": 1},
    ],
)
def test_a_checkpoint_that_does_not_fit_is_refused(change: dict[str, bytes | int | None]) -> None:
    snapshot = after(5).snapshot()
    for name, value in change.items():
        if value is None:
            del snapshot[name]
        else:
            snapshot[name] = value
    fold = after(3)
    refused(fold, lambda: fold.restore(snapshot), ValueError)


def test_a_checkpoint_replaces_all_that_was_answered_before() -> None:
    fold = after(EPISODES[0] + EPISODES[1] + 2)
    fold.restore(after(EPISODES[0] + EPISODES[1] + EPISODES[2]).snapshot())
    with pytest.raises(DivergedError):
        fold.observe(SEEN[EPISODES[0] + EPISODES[1]])
