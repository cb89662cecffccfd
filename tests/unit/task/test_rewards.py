"""The two reward functions at and around their borders."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.task.rewards import reward_of_move
from services.wire.actions import ACTION_NAMES, INSERT
from services.wire.definition import ForceChangeReward, InsertionReward

BY_MOVE = InsertionReward(step=-1.0, insertion_step=0.25)
BY_FORCE = ForceChangeReward(fell=5.0, fell_by=0.5, rose=-5.0, rose_by=0.25, otherwise=-1.0)
forces = st.floats(1e-6, 1e5)


@given(st.integers(0, len(ACTION_NAMES) - 1), forces, forces)
def test_the_insertion_reward_looks_at_the_move_only(action: int, before_n: float, after_n: float) -> None:
    assert reward_of_move(BY_MOVE, action, before_n, after_n) == (0.25 if action == INSERT else -1.0)


@pytest.mark.parametrize(
    ("before_n", "after_n", "reward"),
    [
        (4.0, 2.0, 5.0),
        (4.0, math.nextafter(2.0, 3.0), -1.0),
        (4.0, 0.0, 5.0),
        (4.0, 4.0, -1.0),
        (4.0, math.nextafter(5.0, 4.0), -1.0),
        (4.0, 5.0, -5.0),
        (4.0, 400.0, -5.0),
        (0.5, 0.25, 5.0),
        (0.5, 0.625, -5.0),
    ],
)
def test_the_force_reward_at_its_borders(before_n: float, after_n: float, reward: float) -> None:
    assert reward_of_move(BY_FORCE, 0, before_n, after_n) == reward


@pytest.mark.parametrize(("before_n", "after_n"), [(5.0, 6.0), (10.0, 12.0), (2.5, 3.0)])
def test_a_fifth_more_is_a_rise_by_default(before_n: float, after_n: float) -> None:
    assert reward_of_move(ForceChangeReward(), 0, before_n, after_n) == -5.0


@given(st.integers(0, 10), forces, forces)
def test_the_force_reward_does_not_look_at_the_move(action: int, before_n: float, after_n: float) -> None:
    assert reward_of_move(BY_FORCE, action, before_n, after_n) == reward_of_move(BY_FORCE, 0, before_n, after_n)


@given(forces, forces, forces)
def test_less_force_is_never_worth_less(before_n: float, one_n: float, other_n: float) -> None:
    low, high = sorted((one_n, other_n))
    assert reward_of_move(BY_FORCE, 0, before_n, low) >= reward_of_move(BY_FORCE, 0, before_n, high)
