"""Stochastic real-valued units, by hand: the thesis's equations, bounds, memory, and that they learn."""

from __future__ import annotations

import math
from itertools import pairwise
from statistics import fmean

import pytest

from services.agent.srv import INPUTS, Srv
from services.rules.bounds import Bounds
from services.rules.plugins import Lesson
from services.rules.wrench import Wrench
from services.wire.actions import Increment
from services.wire.definition import Continuous, Definition, Moves
from services.wire.randomness import Role, generator

DEFINITION = Definition(name="test", moves=Moves(continuous=Continuous(x_mm=0.2, z_mm=0.2)))
BOUNDS = Bounds(DEFINITION)
PUSH = Wrench((0.0, 0.0, -3.0), (0.0, 0.0, 0.0))
ASIDE = Wrench((2.0, 0.0, -1.0), (0.0, 0.01, 0.0))


def srv(**settings: float) -> Srv:
    return Srv(BOUNDS, settings, 5)


def lesson(increment: Increment, reward: float, felt: Wrench = PUSH) -> Lesson:
    return Lesson(0, 0, reward, felt, None, increment)


def test_first_move_is_drawn_round_the_middle() -> None:
    z_x, z_z = generator(5, Role.POLICY, 2, 7).standard_normal(2).tolist()
    increment = srv(spread=0.1).decide_move(None, 0, PUSH, 2, 7)
    assert increment == pytest.approx((0.02 * z_x, 0.0, 0.1 + 0.01 * z_z, 0.0, 0.0, 0.0), abs=1.1e-4)


def test_equations_2_5_and_2_6() -> None:
    units = srv(alpha=0.5, beta=0.25, spread=0.4, unit_n=3.0, reward_unit=10.0)
    units.finish_move(lesson(Increment(dx_mm=0.1, dz_mm=0.2), 10.0))
    size = 3.0 + 1e-6
    bounded, direction = size / (size + 3.0), -3.0 / size
    x = [1.0, 0.0, 0.0, bounded * direction, 0.0, 0.0, 0.0, bounded, 0.0, 0.0, -direction, 0.0, 0.0, 0.0]
    assert len(x) == INPUTS
    # r = (1 + 1/(1 + 1))/2 = 0.75, nothing expected, sigma 0.4, means 0; the move is half of +X and all of +Z.
    for theta, part in zip(units._theta, (0.5, 1.0), strict=True):
        assert theta == pytest.approx([0.5 * 0.75 * (part - 0.0) / 0.4 * value for value in x])
    assert units._phi == pytest.approx([0.25 * 0.75 * value for value in x])
    assert units.version == 1


def test_spread_falls_with_what_is_expected_and_not_below_its_least() -> None:
    units = srv(beta=0.2, alpha=0.0, spread=0.5, spread_least=0.06)
    spreads = [units.proposal(0, PUSH, 0).spread.dx_mm]
    for _ in range(60):
        units.finish_move(lesson(Increment(), 1e6))
        spreads.append(units.proposal(0, PUSH, 0).spread.dx_mm)
    assert spreads[0] == pytest.approx(0.5 * 0.2) and spreads[-1] == pytest.approx(0.06 * 0.2)
    assert all(later <= earlier for earlier, later in pairwise(spreads))
    assert units.proposal(0, PUSH, 0).worth == pytest.approx(1.0, abs=1e-3)


def test_they_learn_to_go_away_from_a_force_and_to_insert_without_one() -> None:
    units = srv(alpha=0.1, beta=0.1, reward_unit=1.0)
    felt = {1: ASIDE, 0: PUSH, -1: Wrench((-2.0, 0.0, -1.0), (0.0, -0.01, 0.0))}
    for step in range(3000):
        side = step % 3 - 1
        increment = units.decide_move(None, 0, felt[side], 0, step)
        wanted = Increment(dx_mm=0.2 * side, dz_mm=0.2 if side == 0 else 0.0)
        units.finish_move(lesson(increment, -10 * math.dist(increment, wanted), felt[side]))
    for side, wrench in felt.items():
        means = units.proposal(0, wrench, 0)
        assert means.increment.dx_mm == pytest.approx(0.2 * side, abs=0.06)
        assert (means.increment.dz_mm > 0.1) == (side == 0)
    assert fmean(units.proposal(0, wrench, 0).worth for wrench in felt.values()) > 0.4, "of at most 1/2"


def test_what_is_restored_goes_on_to_the_last_bit() -> None:
    units, other = srv(), srv()
    for step in range(20):
        units.decide_move(lesson(Increment(dx_mm=0.013 * (step % 7)), -step), 0, ASIDE, 0, step)
    other.restore(units.snapshot())
    assert other.digest() == units.digest() and other.version == units.version == 20
    follow = [learner.decide_move(lesson(Increment(dz_mm=0.1), 1.0), 0, PUSH, 1, 0) for learner in (units, other)]
    assert follow[0] == follow[1] and other.digest() == units.digest() != srv().digest()


def test_asking_changes_nothing_and_too_many_idle_moves_teach_nothing() -> None:
    units = srv()
    units.proposal(3, ASIDE, 9)
    units.finish_move(lesson(Increment(), -50.0)._replace(outcome="no_progress"))
    assert (units.version, units.digest()) == (0, srv().digest())


@pytest.mark.parametrize("field", ["states", "version", "units", "weights"])
def test_a_snapshot_that_does_not_fit_is_refused(field: str) -> None:
    units = srv()
    for snapshot in (
        {name: value for name, value in units.snapshot().items() if name != field},
        units.snapshot() | {field: -1},
        units.snapshot() | {field: b"123"},
    ):
        with pytest.raises(ValueError, match="snapshot: expected"):
            units.restore(snapshot)
    assert units.digest() == srv().digest()


@pytest.mark.parametrize(
    "wrong", [lesson(Increment(), math.inf), lesson(Increment(), 1.0)._replace(increment=None)], ids=["reward", "move"]
)
def test_lessons_that_are_none_change_nothing(wrong: Lesson) -> None:
    units = srv()
    with pytest.raises(ValueError, match="expected a move and a finite reward"):
        units.decide_move(wrong, 0, PUSH, 0, 1)
    with pytest.raises(ValueError, match="expected numbers within"):
        units.decide_move(lesson(Increment(), 1.0), 0, Wrench((math.nan, 0.0, 0.0), (0.0, 0.0, 0.0)), 0, 1)
    assert (units.version, units.digest()) == (0, srv().digest())


def test_settings_that_are_none_are_refused() -> None:
    with pytest.raises(ValueError, match="spread"):
        srv(spread=0.0)
    with pytest.raises(ValueError, match="gamma"):
        srv(gamma=0.9)
