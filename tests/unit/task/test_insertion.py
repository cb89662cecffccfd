"""The state machine of an episode: what follows from which sample."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.task.insertion import Insertion
from services.wire.actions import INSERT, increments
from services.wire.definition import Definition, InsertionReward
from services.wire.errors import TreenailError
from services.wire.messages import EpisodeSummary, Move, Moved, Observation, Reward

Make = Callable[..., Any]
RUN = "test-s0"


# -- guidance and contact ------------------------------------------------------------------------------------------


def test_without_contact_the_peg_is_guided_in(bench: Make, below: Make) -> None:
    at = bench()
    at.home(episode=3, first_decision=11)
    for step in range(1, 4):
        felt = at.feel(below(0.5))
        assert felt.reward is None
        assert felt.then == Move(run=RUN, episode=3, step=step, dz_mm=0.25)
    assert at.task.record().steps == ()


def test_at_the_contact_force_the_agent_is_asked(bench: Make) -> None:
    at = bench()
    at.home(episode=3, first_decision=11)
    at.feel(0.0)
    felt = at.feel(0.5, torque=0.125)
    assert felt.reward is None
    assert felt.then == Observation(
        run=RUN, episode=3, step=1, decision=11, force_n=(0.0, 0.0, -0.5), torque_nm=(0.125, 0.0, 0.0)
    )


def test_contact_goes_by_the_magnitude_of_all_components(bench: Make) -> None:
    at = bench()
    at.home()
    assert isinstance(at.feel((0.3, 0.0, 0.4)).then, Observation)
    at.home()
    assert isinstance(at.feel((0.3, 0.0, 0.39)).then, Move)


def test_torque_alone_is_no_contact(bench: Make) -> None:
    at = bench()
    at.home()
    assert isinstance(at.feel(0.0, torque=5.0).then, Move)


def test_an_action_becomes_its_increment(bench: Make, exact: Make) -> None:
    at = bench()
    at.home(episode=2)
    at.feel(1.0)
    for action, increment in enumerate(increments(exact().moves)):
        step = action + 1
        assert at.act(action) == Move(run=RUN, episode=2, step=step, **increment._asdict())
        at.feel(1.0)


# -- how episodes end ----------------------------------------------------------------------------------------------


def test_at_the_limit_it_is_a_collision(bench: Make, below: Make) -> None:
    at = bench()
    at.home()
    at.feel(1.0)
    assert isinstance(at.touch(0, below(8.0)).then, Observation)
    assert isinstance(at.touch(0, 8.0).then, EpisodeSummary)
    assert at.summary().outcome == "collision"
    assert at.rewards == [-1.0, -100.0]


def test_depth_counts_what_was_applied(bench: Make) -> None:
    """8 mm below the mouth, from 1 mm above it, is 9 mm of +Z: with 0.25 mm moves the 36th."""
    at = bench()
    at.home()
    for _ in range(36):
        assert isinstance(at.feel(0.0).then, Move)
    at.feel(0.0)
    assert at.summary().outcome == "inserted"
    assert at.summary().moves == 36


def test_depth_does_not_count_what_was_only_asked(bench: Make) -> None:
    at = bench()
    at.home()
    at.feel(0.0)
    for _ in range(71):
        assert isinstance(at.feel(0.0, dz_mm=0.125).then, Move)
    at.feel(0.0, dz_mm=0.125)
    assert at.summary().outcome == "inserted"
    assert at.summary().moves == 72


def test_depth_has_nothing_to_do_with_force_or_sideways_moves(bench: Make) -> None:
    at = bench()
    at.home()
    at.feel(7.0)
    for _ in range(100):
        assert isinstance(at.touch(0, 7.0).then, Observation)


def test_insertion_by_decisions_ends_with_the_reward_of_its_last_move(bench: Make) -> None:
    at = bench()
    at.home()
    at.feel(1.0)
    for _ in range(35):
        assert isinstance(at.touch(INSERT, 1.0).then, Observation)
    felt = at.touch(INSERT, 1.0)
    assert felt.reward is not None
    assert (felt.reward.reward, felt.reward.terminal, felt.reward.decision) == (0.0, "inserted", 35)
    assert at.summary().outcome == "inserted"


def test_at_the_depth_with_too_much_force_it_is_a_collision(bench: Make) -> None:
    at = bench()
    at.home()
    at.feel(0.0, dz_mm=0.0)
    at.feel(8.0, dz_mm=9.0)
    assert at.summary().outcome == "collision"


@pytest.mark.parametrize("limit", [1, 2, 5])
def test_the_no_progress_rule_allows_its_number_of_moves(bench: Make, limit: int) -> None:
    at = bench(no_progress_moves=limit)
    at.home()
    at.feel(1.0)
    for _ in range(limit):
        assert isinstance(at.touch(0, 1.0).then, Observation)
    felt = at.touch(0, 1.0)
    assert at.summary().outcome == "no_progress"
    assert felt.reward is not None
    assert (felt.reward.reward, felt.reward.terminal) == (-50.0, "no_progress")


def test_an_insertion_step_starts_the_no_progress_count_again(bench: Make) -> None:
    at = bench(no_progress_moves=2)
    at.home()
    at.feel(1.0)
    for _ in range(3):
        for action in (0, 1, INSERT):
            assert isinstance(at.touch(action, 1.0).then, Observation)
    at.touch(0, 1.0)
    at.touch(0, 1.0)
    assert isinstance(at.touch(0, 1.0).then, EpisodeSummary)


def test_guidance_starts_the_no_progress_count_again(bench: Make) -> None:
    at = bench(no_progress_moves=2)
    at.home()
    at.feel(1.0)
    for _ in range(4):
        at.touch(0, 1.0)
        assert isinstance(at.touch(0, 0.0).then, Move)
        assert isinstance(at.feel(1.0).then, Observation)


def test_a_new_episode_starts_the_no_progress_count_again(bench: Make) -> None:
    at = bench(no_progress_moves=2)
    for episode in range(2):
        at.home(episode, 2 * episode)
        at.feel(1.0)
        at.touch(0, 1.0)
        assert isinstance(at.touch(0, 1.0).then, Observation)


def test_without_the_no_progress_rule_nothing_ends_early(bench: Make) -> None:
    at = bench(no_progress_moves=0)
    at.home()
    at.feel(1.0)
    for _ in range(999):
        assert isinstance(at.touch(0, 1.0).then, Observation)
    assert at.touch(0, 1.0).reward.terminal == "move_limit"


def test_the_move_limit_ends_an_episode_after_its_last_move(bench: Make) -> None:
    at = bench(move_limit=10)
    at.home()
    at.feel(1.0)
    for _ in range(9):
        assert isinstance(at.touch(0, 1.0).then, Observation)
    felt = at.touch(0, 1.0)
    assert at.summary().outcome == "move_limit"
    assert at.summary().moves == 10
    assert (felt.reward.reward, felt.reward.terminal) == (-1.0, "move_limit")


def test_the_move_limit_holds_for_guidance_too(bench: Make) -> None:
    at = bench(move_limit=10)
    at.home()
    for _ in range(10):
        assert isinstance(at.feel(0.0).then, Move)
    at.feel(0.0)
    assert at.summary().outcome == "move_limit"


def test_several_ends_at_once_have_an_order(bench: Make) -> None:
    both = {"move_limit": 10, "no_progress_moves": 9}
    for force, outcome in ((1.0, "no_progress"), (8.0, "collision")):
        at = bench(**both)
        at.home()
        at.feel(1.0)
        for _ in range(9):
            at.touch(0, 1.0)
        at.touch(0, force)
        assert at.summary().outcome == outcome


# -- what is refused -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [0, 2, 99])
def test_the_reply_to_another_motion_is_refused(bench: Make, step: int) -> None:
    at = bench()
    at.home()
    at.feel(0.0)
    before = at.task.record()
    with pytest.raises(TreenailError, match=f"expected the reply to motion 1, got {step}"):
        at.task.feel(Moved(run=RUN, episode=0, step=step, arrived_t_ns=0), (0.0, 0.0, -1.0), (0.0, 0.0, 0.0))
    assert at.task.record() == before
    assert isinstance(at.feel(1.0).then, Observation)


@pytest.mark.parametrize(("action", "decision"), [(9, 5), (63, 5), (0, 4), (0, 6)])
def test_a_wrong_action_is_refused_and_a_right_one_still_taken(
    bench: Make, answered: Make, action: int, decision: int
) -> None:
    at = bench()
    at.home(first_decision=5)
    observation = at.feel(1.0).then
    assert isinstance(observation, Observation)
    wrong = observation.__class__(
        run=RUN, episode=0, step=0, decision=decision, force_n=(0.0, 0.0, 0.0), torque_nm=(0.0, 0.0, 0.0)
    )
    before = at.task.record()
    with pytest.raises(TreenailError, match=r"^task: "):
        at.task.act(answered(wrong, action))
    assert at.task.record() == before
    assert at.act(8).ry_deg == -0.5


def test_an_action_that_nobody_asked_for_is_refused(bench: Make, answered: Make) -> None:
    at = bench()
    at.home()
    observation = at.feel(1.0).then
    at.act(0)
    with pytest.raises(TreenailError, match="not the one waited for"):
        at.task.act(answered(observation, 0))
    at.feel(0.0)
    with pytest.raises(TreenailError, match="not the one waited for"):
        at.task.act(answered(observation, 0))
    at.home(1, 1)
    with pytest.raises(TreenailError, match="not the one waited for"):
        at.task.act(answered(observation, 0))


def test_the_same_sample_twice_is_refused(bench: Make) -> None:
    """A reply that is taken twice would ask the agent twice and count its depth twice."""
    at = bench()
    at.home()
    at.feel(0.0)
    moved = Moved(run=RUN, episode=0, step=1, arrived_t_ns=1, dz_mm=0.25)
    at.task.feel(moved, (0.0, 0.0, -1.0), (0.0, 0.0, 0.0))
    before = at.task.record()
    with pytest.raises(TreenailError):
        at.task.feel(moved, (0.0, 0.0, -1.0), (0.0, 0.0, 0.0))
    assert at.task.record() == before


# -- numbers of the summary ----------------------------------------------------------------------------------------


def test_the_summary_adds_up(bench: Make) -> None:
    at = bench(reward=InsertionReward(step=-1.0, insertion_step=0.5))
    at.home(episode=4, first_decision=20)
    at.feel(1.0, torque=9.0)  # before the first motion: decided on, not part of means and peaks
    at.act(INSERT, state=2)
    at.feel(2.0, torque=0.5)
    at.act(0, state=5)
    at.feel(0.0, torque=0.0)
    at.feel(10.0, torque=0.25)
    assert at.summary() == EpisodeSummary(
        run=RUN,
        episode=4,
        episode_return=0.5 - 100.0,
        moves=3,
        decisions=2,
        mean_force_n=4.0,
        peak_force_n=10.0,
        mean_torque_nm=0.25,
        peak_torque_nm=0.5,
        states=6,
        outcome="collision",
    )


def test_states_are_those_of_all_episodes_so_far(bench: Make) -> None:
    at = bench()
    for episode, (state, states) in enumerate([(3, 4), (1, 4), (6, 7)]):
        at.home(episode, episode)
        at.feel(1.0)
        at.touch(0, 9.0, state=state)
        assert at.summary().states == states
    at.task.expect_states(12)
    at.home(3, 3)
    at.feel(9.0)
    assert at.summary().states == 12


def test_a_collision_at_home_has_finite_numbers(bench: Make) -> None:
    at = bench()
    at.home()
    at.feel(9.0)
    summary = at.summary()
    assert (summary.moves, summary.decisions, summary.mean_force_n, summary.peak_force_n) == (0, 0, 0.0, 0.0)


@given(st.lists(st.tuples(st.floats(0, 9), st.integers(0, 8)), min_size=60, max_size=60))
@settings(max_examples=40, deadline=None)
def test_any_episode_is_consistent(answered: Make, samples: list[tuple[float, int]]) -> None:
    definition = Definition(name="any")
    task = Insertion(definition, RUN, 0)
    home = task.home(0, 100)
    moved = Moved(run=RUN, episode=0, step=0, arrived_t_ns=0)
    assert home.episode == 0
    earned: list[Reward] = []
    steps: list[int] = []
    decisions: list[int] = []
    for force, action in samples:
        felt = task.feel(moved, (force, 0.0, 0.0), (0.0, 0.0, 0.0))
        if felt.reward is not None:
            earned.append(felt.reward)
        if isinstance(felt.then, EpisodeSummary):
            summary = felt.then
            untaught = -100.0 if summary.outcome == "collision" and not decisions else 0.0
            assert math.isclose(summary.episode_return, sum(reward.reward for reward in earned) + untaught)
            assert [reward.decision for reward in earned] == decisions
            assert [reward.step for reward in earned] == steps
            assert [reward.terminal for reward in earned] == [None] * (len(earned) - 1) + [summary.outcome] * bool(
                earned
            )
            assert summary.mean_force_n <= summary.peak_force_n or summary.moves == 0
            return
        motion = felt.then
        if isinstance(motion, Observation):
            steps.append(motion.step)
            decisions.append(motion.decision)
            assert decisions == list(range(100, 100 + len(decisions)))
            motion = task.act(answered(motion, action))
        assert motion.step == moved.step + 1
        moved = Moved(run=RUN, episode=0, step=motion.step, arrived_t_ns=motion.step, dz_mm=motion.dz_mm)
