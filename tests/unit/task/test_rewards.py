"""The two reward functions at and around their borders, and what is added to them."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from services.task.rewards import Potential, end_reward, reward_of_move
from services.wire.actions import INSERT, increments
from services.wire.definition import Definition, Felt, ForceChangeReward, InsertionReward, Moves, Shaping
from services.wire.messages import Outcome

BY_MOVE = InsertionReward(step=-1.0, insertion_step=0.25)
BY_FORCE = ForceChangeReward(fell=5.0, fell_by=0.5, rose=-5.0, rose_by=0.25, otherwise=-1.0)
forces = st.floats(1e-6, 1e5)


@given(st.integers(0, 8), forces, forces)
def test_the_insertion_reward_looks_at_the_move_only(action: int, before_n: float, after_n: float) -> None:
    expected = 0.25 if action == INSERT else -1.0
    assert reward_of_move(BY_MOVE, increments(Moves())[action].dz_mm, before_n, after_n) == expected


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
    assert reward_of_move(BY_FORCE, 0.0, before_n, after_n) == reward


@pytest.mark.parametrize(("before_n", "after_n"), [(5.0, 6.0), (10.0, 12.0), (2.5, 3.0)])
def test_a_fifth_more_is_a_rise_by_default(before_n: float, after_n: float) -> None:
    assert reward_of_move(ForceChangeReward(), 0.0, before_n, after_n) == -5.0


@given(forces, forces)
def test_the_force_reward_does_not_look_at_the_move(before_n: float, after_n: float) -> None:
    assert reward_of_move(BY_FORCE, 0.2, before_n, after_n) == reward_of_move(BY_FORCE, 0.0, before_n, after_n)


@given(forces, forces, forces)
def test_less_force_is_never_worth_less(before_n: float, one_n: float, other_n: float) -> None:
    low, high = sorted((one_n, other_n))
    assert reward_of_move(BY_FORCE, 0.0, before_n, low) >= reward_of_move(BY_FORCE, 0.0, before_n, high)


# -- what is added ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("outcome", "reward"), [("collision", -100.0), ("no_progress", -50.0), ("inserted", 6.0), ("move_limit", -1.0)]
)
def test_what_an_end_earns(outcome: Outcome, reward: float) -> None:
    assert end_reward(InsertionReward(success=7.0), outcome, -1.0) == reward


def test_the_potential_is_force_and_torque_at_the_point_that_the_definition_names() -> None:
    shaping = Shaping(price_per_n=2.0, torque_per_m=20.0, gamma=0.5)
    potential = Potential(Definition(name="test", felt=Felt(torque="lever", lever_mm=100.0), shaping=shaping))
    assert potential.of((3.0, 0.0, -4.0), (0.0, 0.3, 0.0)) == pytest.approx(5.0)
    assert potential.of((3.0, 0.0, -4.0), (0.25, 0.3, 0.0)) == pytest.approx(5.0 + 20.0 * 0.25)
    assert potential.price(0.2, 5.0, 8.0) == 2.0 * (5.0 - 0.5 * 8.0)
    assert Potential(Definition(name="test")).of((3.0, 0.0, -4.0), (0.0, 0.3, 0.0)) == 0.0


def test_a_move_back_out_earns_the_same_whatever_it_did() -> None:
    for reward in (InsertionReward(back=-4.0), ForceChangeReward(back=-4.0)):
        assert {reward_of_move(reward, -0.2, 5.0, after_n) for after_n in (0.0, 5.0, 9.0)} == {-4.0}
    priced = Potential(Definition(name="test", shaping=Shaping(price_per_n=2.0)))
    assert priced.price(-0.2, 8.0, 0.0) == 0.0


Rows = NDArray[np.float64]
STATES, ACTIONS = 7, 3
"""A small task: states 0 to 6, and an end from which nothing follows."""


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("price", [0.5, 2.0, 20.0])
def test_the_price_of_force_leaves_the_best_policy_what_it_is(seed: int, price: float) -> None:
    gamma = 0.9
    draws = np.random.default_rng(seed)
    potential = Potential(Definition(name="test", shaping=Shaping(price_per_n=price, gamma=gamma)))
    forces, torques = draws.normal(0.0, 3.0, (STATES, 3)).tolist(), draws.normal(0.0, 0.1, (STATES, 3)).tolist()
    phi = [potential.of(tuple(force), tuple(torque)) for force, torque in zip(forces, torques, strict=True)] + [0.0]
    chances = draws.dirichlet(np.full(STATES + 1, 0.3), (STATES, ACTIONS))
    plain = draws.normal(-1.0, 1.0, (STATES, ACTIONS, STATES + 1))
    shaped = plain.copy()
    for state, after in itertools.product(range(STATES), range(STATES + 1)):
        shaped[state, :, after] += potential.price(0.0, phi[state], phi[after])
    best, best_shaped = best_values(chances, plain, gamma), best_values(chances, shaped, gamma)
    assert (best.argmax(axis=1) == best_shaped.argmax(axis=1)).all()
    # All actions of a state are worth as much more as its potential: their order and distances stay.
    assert best_shaped == pytest.approx(best + price * np.array(phi[:STATES])[:, None], abs=1e-8)
    # With another discount factor it would be another task.
    wrong = best_values(chances, shaped, 0.5)
    assert wrong != pytest.approx(best_values(chances, plain, 0.5) + price * np.array(phi[:STATES])[:, None], abs=1e-3)


def best_values(chances: Rows, rewards: Rows, gamma: float) -> Rows:
    """Return the action values of the best policy, shape (states, actions), by value iteration."""
    values = np.zeros((STATES, ACTIONS))
    for _ in range(2000):
        worth = np.append(values.max(axis=1), 0.0)
        values = (chances * (rewards + gamma * worth)).sum(axis=2)
    return values
