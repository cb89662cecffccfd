"""Which decision earns what, and when it is told."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from services.wire.actions import INSERT
from services.wire.definition import ForceChangeReward, InsertionReward
from services.wire.messages import EpisodeSummary, Move, Observation, Reward

Make = Callable[..., Any]
RUN = "test-s0"
BY_FORCE = ForceChangeReward(fell=5.0, fell_by=0.5, rose=-5.0, rose_by=0.25, otherwise=-1.0, collision=-200.0)


def test_a_reward_comes_with_the_next_contact(bench: Make) -> None:
    at = bench()
    at.home(episode=1, first_decision=40)
    at.feel(0.0)
    at.feel(1.0)
    felt = at.touch(0, 1.0)
    assert felt.reward == Reward(run=RUN, episode=1, step=1, decision=40, reward=-1.0, terminal=None)
    assert isinstance(felt.then, Observation)
    assert (felt.then.step, felt.then.decision) == (2, 41)
    felt = at.touch(INSERT, 1.0)
    assert felt.reward == Reward(run=RUN, episode=1, step=2, decision=41, reward=0.0, terminal=None)


def test_a_reward_waits_while_the_peg_is_guided(bench: Make) -> None:
    at = bench()
    at.home()
    at.feel(1.0)
    assert at.touch(0, 0.0).reward is None
    for _ in range(3):
        felt = at.feel(0.0)
        assert felt.reward is None
        assert isinstance(felt.then, Move)
    felt = at.feel(1.0)
    assert felt.reward == Reward(run=RUN, episode=0, step=0, decision=0, reward=-1.0, terminal=None)
    assert isinstance(felt.then, Observation)
    assert (felt.then.step, felt.then.decision) == (5, 1)


GENTLE = InsertionReward(force_per_n=4.0)


def test_the_force_that_a_move_leaves_costs(bench: Make) -> None:
    at = bench(reward=GENTLE)
    at.home()
    at.feel(1.0)
    assert at.touch(0, 2.0).reward.reward == -1.0 - 4.0 * 2.0
    assert at.touch(INSERT, 1.5).reward.reward == 0.0 - 4.0 * 1.5


def test_where_contact_is_lost_it_is_the_little_that_is_left_and_not_what_is_touched_next(bench: Make) -> None:
    at = bench(reward=GENTLE)
    at.home()
    at.feel(1.0)
    assert at.touch(0, 0.25).reward is None
    assert at.feel(0.125).reward is None
    assert at.feel(3.0).reward.reward == -1.0 - 4.0 * 0.25


def test_where_the_episode_ends_force_costs_nothing_beside_the_end(bench: Make) -> None:
    at = bench(reward=GENTLE)
    at.home()
    at.feel(1.0)
    felt = at.touch(0, 9.0)
    assert (felt.reward.terminal, felt.reward.reward) == ("collision", -100.0)


def test_a_collision_in_a_guided_move_is_the_last_decisions(bench: Make) -> None:
    at = bench()
    at.home()
    at.feel(1.0)
    at.touch(0, 0.0)
    at.feel(0.0)
    felt = at.feel(9.0)
    assert felt.reward == Reward(run=RUN, episode=0, step=0, decision=0, reward=-100.0, terminal="collision")
    assert at.summary().episode_return == -100.0
    assert at.summary().decisions == 1


def test_an_insertion_in_a_guided_move_is_the_last_decisions_with_its_own_reward(bench: Make) -> None:
    at = bench()
    at.home()
    at.feel(1.0)
    at.touch(0, 0.0)
    while isinstance(at.felt.then, Move):
        at.feel(0.0)
    assert at.felt.reward == Reward(run=RUN, episode=0, step=0, decision=0, reward=-1.0, terminal="inserted")
    assert at.summary().episode_return == -1.0


def test_the_first_touch_that_is_a_collision_teaches_nobody_but_counts(bench: Make) -> None:
    at = bench()
    at.home(episode=2, first_decision=17)
    at.feel(0.0)
    felt = at.feel(8.0)
    assert felt.reward is None
    assert isinstance(felt.then, EpisodeSummary)
    assert (felt.then.outcome, felt.then.decisions, felt.then.episode_return) == ("collision", 0, -100.0)


def test_an_insertion_without_any_contact_costs_nothing(bench: Make) -> None:
    at = bench()
    at.home()
    while not isinstance(at.feel(0.0).then, EpisodeSummary):
        pass
    assert at.summary().episode_return == 0.0
    assert at.rewards == []


def test_the_return_is_the_sum_of_the_rewards(bench: Make) -> None:
    at = bench(reward=InsertionReward(step=-1.5, insertion_step=0.25, collision=-64.0))
    at.home()
    at.feel(1.0)
    for action, force in ((0, 1.0), (INSERT, 0.0)):
        at.touch(action, force)
    at.feel(0.0)
    at.feel(2.0)
    at.touch(3, 9.0)
    assert at.rewards == [-1.5, 0.25, -64.0]
    assert at.summary().episode_return == sum(at.rewards)


@pytest.mark.parametrize(
    ("before_n", "after_n", "reward"),
    [
        (4.0, 2.0, 5.0),
        (4.0, math.nextafter(2.0, 3.0), -1.0),
        (4.0, math.nextafter(5.0, 4.0), -1.0),
        (4.0, 5.0, -5.0),
    ],
)
def test_the_force_change_goes_from_the_observation_to_the_move(
    bench: Make, before_n: float, after_n: float, reward: float
) -> None:
    at = bench(reward=BY_FORCE)
    at.home()
    at.feel(7.0)
    at.touch(0, before_n)
    assert at.touch(0, after_n).reward.reward == reward


def test_the_force_change_is_that_of_the_decisions_own_move(bench: Make) -> None:
    """Losing contact is a fall of the force, whatever the guided moves after it run into."""
    at = bench(reward=BY_FORCE)
    at.home()
    at.feel(2.0)
    at.touch(0, 0.25)
    at.feel(0.0)
    assert at.feel(7.0).reward.reward == 5.0
    assert at.touch(0, 7.0).reward.reward == -1.0


def test_a_collision_counts_instead_of_the_force_change(bench: Make) -> None:
    at = bench(reward=BY_FORCE, no_progress_moves=1)
    at.home()
    at.feel(2.0)
    assert at.touch(0, 8.0).reward.reward == -200.0
    at.home(1, 1)
    at.feel(2.0)
    at.touch(0, 1.0)
    assert at.touch(0, 0.5).reward.reward == -50.0
    assert at.summary().episode_return == 5.0 - 50.0


def test_nothing_of_an_unfinished_episode_is_left_in_the_next(bench: Make) -> None:
    at = bench()
    at.home()
    at.feel(1.0)
    at.touch(0, 0.0)  # a reward waits
    at.home(0, 0)
    at.feel(0.0)
    assert at.feel(9.0).reward is None
    assert at.summary().episode_return == -100.0
    assert at.summary().moves == 1
