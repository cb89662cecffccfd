"""O, A, T in both conventions, TRANS texts, and the probe that tells the conventions apart."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.robot_link.emulator import poses
from services.robot_link.val2 import oat
from services.robot_link.val2.oat import Convention, Location, Pose
from services.wire.actions import Increment

ANGLE = st.floats(-179.0, 179.0)
SMALL = st.floats(-2.0, 2.0)

GOLDEN: tuple[tuple[Increment, str, str], ...] = (
    (Increment(rx_deg=0.2), "TRANS(0,0,0,-90,0.2,90)", "TRANS(0,0,0,0,-89.8,90)"),
    (Increment(rx_deg=-0.2), "TRANS(0,0,0,90,0.2,-90)", "TRANS(0,0,0,180,-89.8,-90)"),
    (Increment(ry_deg=0.2), "TRANS(0,0,0,0,0.2,0)", "TRANS(0,0,0,90,-89.8,0)"),
    (Increment(ry_deg=-0.2), "TRANS(0,0,0,180,0.2,-180)", "TRANS(0,0,0,270,-89.8,-180)"),
    (Increment(rz_deg=0.2), "TRANS(0,0,0,0,0,0.2)", "TRANS(0,0,0,90,-90,0.2)"),
    (Increment(rz_deg=-0.2), "TRANS(0,0,0,0,0,-0.2)", "TRANS(0,0,0,90,-90,-0.2)"),
    (Increment(dx_mm=0.2, dy_mm=-0.2), "TRANS(0.2,-0.2,0,0,0,0)", "TRANS(0.2,-0.2,0,90,-90,0)"),
)
"""The table of small turns about a tool axis."""


def angle_between(one: oat.Matrix, other: oat.Matrix) -> float:
    zero = (0.0, 0.0, 0.0)
    return oat.apart(Pose(zero, one), Pose(zero, other))[1]


@pytest.mark.parametrize(("increment", "zyz", "offset"), GOLDEN)
def test_one_action_is_written_and_applied_exactly(increment: Increment, zyz: str, offset: str) -> None:
    assert oat.trans_text(increment, "zyz") == (zyz, increment)
    assert oat.trans_text(increment, "val_offset") == (offset, increment)


def test_worked_examples() -> None:
    turn = oat.product(oat.product(oat.about_x(0.2), oat.about_y(-0.1)), oat.about_z(0.3))
    assert oat.angles_of(turn, "zyz") == pytest.approx((-116.565121, 0.223607, 116.864946), abs=1e-6)
    assert oat.angles_of(turn, "val_offset") == pytest.approx((-26.565121, -89.776393, 116.864946), abs=1e-6)
    tilted = oat.matrix_of(30, 45, 60, "zyz")
    expected = ((-0.126826, -0.780330, 0.612372), (0.926777, 0.126826, 0.353553), (-0.353553, 0.612372, 0.707107))
    for row, wanted in zip(tilted, expected, strict=True):
        assert row == pytest.approx(wanted, abs=1e-6)
    assert oat.angles_of(tilted, "val_offset") == pytest.approx((120, -45, 60))
    turned = oat.product(tilted, oat.about_x(0.2))
    assert oat.angles_of(turned, "zyz") == pytest.approx((29.859005, 45.173292, 60.099548), abs=1e-6)
    assert oat.angles_of(turned, "val_offset") == pytest.approx((119.859005, -44.826708, 60.099548), abs=1e-6)


def test_the_hand_of_val_1977_points_along_minus_y() -> None:
    assert oat.matrix_of(0, 0, 0, "val_offset") == ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0))
    assert oat.matrix_of(90, -90, 0, "val_offset") == ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@pytest.mark.parametrize("convention", oat.CONVENTIONS)
@given(o=ANGLE, a=ANGLE, t=ANGLE)
def test_angles_round_trip_and_agree_with_the_emulator(convention: Convention, o: float, a: float, t: float) -> None:
    turn = oat.matrix_of(o, a, t, convention)
    assert angle_between(turn, oat.matrix_of(*oat.angles_of(turn, convention), convention)) < 1e-6
    place = poses.frame((1.0, 2.0, 3.0, o, a, t), convention)
    assert np.allclose(place[:3, :3], turn, atol=1e-12)
    again = poses.frame(poses.numbers_of(place, convention), convention)
    assert np.allclose(again, place, atol=1e-7)


@pytest.mark.parametrize("convention", oat.CONVENTIONS)
@given(shift=st.tuples(SMALL, SMALL, SMALL), turn=st.tuples(SMALL, SMALL, SMALL), decimals=st.integers(2, 7))
def test_rounding_stays_below_a_unit_of_the_last_decimal(
    convention: Convention, shift: tuple[float, ...], turn: tuple[float, ...], decimals: int
) -> None:
    increment = Increment(*shift, *turn)
    text, applied = oat.trans_text(increment, convention, decimals)
    said = poses.frame(tuple(float(word) for word in text[6:-1].split(",")), convention)
    unit = 10.0**-decimals
    rows = [tuple(row) for row in said[:3, :3].tolist()]
    assert angle_between(oat.turn_of(increment), (rows[0], rows[1], rows[2])) < unit
    assert all(abs(value - wanted) <= 0.5000001 * unit for value, wanted in zip(said[:3, 3], shift, strict=True))
    grid = 10.0 ** -min(oat.GRID, decimals)
    assert all(abs(value - wanted) <= 0.5 * grid + unit for value, wanted in zip(applied, increment, strict=True))


@pytest.mark.parametrize("convention", oat.CONVENTIONS)
@given(numbers=st.tuples(*[st.integers(-20000, 20000)] * 6))
def test_what_lies_on_the_grid_comes_back_to_the_bit(convention: Convention, numbers: tuple[int, ...]) -> None:
    wanted = Increment(*(value / 10000 for value in numbers))
    text, applied = oat.trans_text(wanted, convention)
    assert applied == wanted
    heard = poses.frame(tuple(float(word) for word in text[6:-1].split(",")), convention)
    assert poses.increment_of(heard) == wanted


def test_rounding_o_and_t_each_by_itself_would_turn_the_peg() -> None:
    increment = Increment(rx_deg=0.05, ry_deg=0.03)
    o, a, t = oat.angles_of(oat.turn_of(increment), "zyz")
    naive = oat.matrix_of(round(o, 0), round(a, 2), round(t, 0) - 1.0, "zyz")
    assert angle_between(oat.turn_of(increment), naive) > 0.5
    text, _ = oat.trans_text(increment, "zyz", 2)
    o, a, t = (float(word) for word in text[6:-1].split(",")[3:])
    assert math.isclose(o + t, 0.0, abs_tol=1e-9)


@pytest.mark.parametrize("convention", oat.CONVENTIONS)
@given(numbers=st.tuples(ANGLE, ANGLE, ANGLE))
def test_the_probe_never_settles_on_the_wrong_convention(
    convention: Convention, numbers: tuple[float, float, float]
) -> None:
    here = poses.frame((400.0, 100.0, 50.0, *numbers), convention)
    probe = here @ poses.frame((0.0,) * 6, convention)
    first, second = (
        Location(*(round(number, 3) for number in poses.numbers_of(place, convention))) for place in (here, probe)
    )
    assert oat.settled_by(first, second) == convention


def test_a_probe_that_fits_nothing_or_is_elsewhere_settles_nothing() -> None:
    here = Location(400, 100, 50, 30, 170, -20)
    assert oat.settled_by(here, here._replace(o=40)) is None
    assert oat.settled_by(here, here._replace(x=401)) is None
