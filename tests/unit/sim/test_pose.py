"""Pose arithmetic: known rotations, and properties that hold for any pose."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.rules.quaternion import multiply
from services.sim.pose import (
    Pose,
    axis,
    conjugate,
    from_angles,
    require_finite,
    rotate,
    rotation_vector,
    way,
)
from services.wire.actions import Increment

angles = st.floats(-30, 30)
lengths = st.floats(-20, 20)
poses = st.builds(Pose.from_tilt, lengths, lengths, lengths, angles, angles, angles)


@pytest.mark.parametrize(
    ("tilt", "vector", "expected"),
    [
        ((90.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        ((0.0, 90.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
        ((0.0, 0.0, 90.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        # X first, then Z: Y goes to Z and stays there.
        ((90.0, 0.0, 90.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        # X first, then Y: Y goes to Z, then to X.
        ((90.0, 90.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),
    ],
)
def test_angles_combine_as_rz_ry_rx(
    tilt: tuple[float, float, float], vector: tuple[float, float, float], expected: tuple[float, float, float]
) -> None:
    assert rotate(from_angles(*tilt), vector) == pytest.approx(expected, abs=1e-12)


def test_translation_is_along_the_tool_axes() -> None:
    pose = Pose.from_tilt(1.0, 2.0, 3.0, 0.0, 90.0, 0.0)
    assert pose.moved(Increment(dz_mm=0.5)).position == pytest.approx((1.5, 2.0, 3.0))
    assert pose.moved(Increment(dx_mm=0.5)).position == pytest.approx((1.0, 2.0, 2.5))


@given(poses, angles, angles, angles)
def test_a_rotation_leaves_the_tip_where_it_was(pose: Pose, rx: float, ry: float, rz: float) -> None:
    assert pose.moved(Increment(rx_deg=rx, ry_deg=ry, rz_deg=rz)).position == pose.position


def test_a_rotation_about_a_point_behind_the_tip_swings_it() -> None:
    """With a lever of 130 mm 0.2 degrees are 0.454 mm; about X the tip goes to -Y, about Y to +X."""
    swing = 130.0 * math.sin(math.radians(0.2))
    assert swing == pytest.approx(0.454, abs=1e-3)
    about_x = Pose(1.0, 2.0, 3.0).moved(Increment(rx_deg=0.2), 130.0)
    assert about_x.position == pytest.approx((1.0, 2.0 - swing, 3.0 - 130.0 * (1.0 - math.cos(math.radians(0.2)))))
    assert Pose(1.0, 2.0, 3.0).moved(Increment(ry_deg=0.2), 130.0).x_mm == pytest.approx(1.0 + swing)


@given(poses, angles, angles, angles)
def test_the_centre_of_a_rotation_stays_where_it_was(pose: Pose, rx: float, ry: float, rz: float) -> None:
    turned = pose.moved(Increment(rx_deg=rx, ry_deg=ry, rz_deg=rz), 90.0)
    assert turned.point(-90.0) == pytest.approx(pose.point(-90.0), abs=1e-9)
    assert turned.orientation == pose.moved(Increment(rx_deg=rx, ry_deg=ry, rz_deg=rz)).orientation


@given(poses, st.sampled_from(["rx_deg", "ry_deg", "rz_deg"]))
def test_a_rotation_and_its_opposite_cancel(pose: Pose, name: str) -> None:
    back = pose.moved(Increment(**{name: 0.2})).moved(Increment(**{name: -0.2}))
    assert back.orientation == pytest.approx(pose.orientation, abs=1e-14)


@given(poses)
def test_axis_and_point_agree_with_rotating_z(pose: Pose) -> None:
    assert axis(pose.orientation) == pytest.approx(rotate(pose.orientation, (0.0, 0.0, 1.0)), abs=1e-12)
    assert math.dist(pose.point(-30.0), pose.position) == pytest.approx(30.0)


@given(poses, angles, angles)
def test_rotation_vector_has_the_angle_of_the_rotation(pose: Pose, rx: float, rz: float) -> None:
    turned = multiply(pose.orientation, from_angles(rx, 0.0, 0.0))
    vector = rotation_vector(multiply(conjugate(pose.orientation), turned))
    assert vector == pytest.approx((math.radians(rx), 0.0, 0.0), abs=1e-9)


@given(poses)
def test_the_way_passes_the_middle(pose: Pose) -> None:
    end = pose.moved(Increment(dx_mm=0.2, rx_deg=0.2))
    for sign in (1.0, -1.0):  # a quaternion and its opposite are one orientation
        (middle,) = way(pose, Pose(*end[:3], *(sign * part for part in end[3:])), 2, 0.0)
        assert middle[:3] == pytest.approx([(a + b) / 2 for a, b in zip(pose[:3], end[:3], strict=True)])
        assert middle[3:] == pytest.approx(pose.moved(Increment(rx_deg=0.1)).orientation, abs=1e-9)


@given(poses, st.floats(-200, 200))
def test_the_way_is_that_of_a_point_of_the_axis_in_equal_parts_without_its_end(pose: Pose, along_mm: float) -> None:
    end = pose.moved(Increment(dz_mm=0.2, ry_deg=0.3))
    passed = way(pose, end, 5, along_mm)
    assert len(passed) == 4
    tips = way(pose, end, 5, 0.0)
    assert [numbers[:3] for numbers in passed] == [Pose(*numbers).point(along_mm) for numbers in tips]
    for part, numbers in enumerate(tips, start=1):
        wanted = [a + part / 5 * (b - a) for a, b in zip(pose[:3], end[:3], strict=True)]
        assert numbers[:3] == pytest.approx(wanted, abs=1e-9)
    assert way(pose, end, 1, along_mm) == []


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused_by_name(bad: float) -> None:
    with pytest.raises(ValueError, match="increment: expected finite numbers"):
        require_finite("increment", Increment(dy_mm=bad))
