"""Torques referred to a point, against T = r x F."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.rules.wrench import Reference, Wrench
from services.wire.definition import Definition, Felt, Wrist

numbers = st.floats(-100, 100)
vectors = st.tuples(numbers, numbers, numbers)
HEIGHT_MM = 130.0


def reference(felt: Felt) -> Reference:
    return Reference(Definition(name="test", wrist=Wrist(sensor_height_mm=HEIGHT_MM), felt=felt))


@given(vectors, vectors)
def test_as_read_nothing_is_touched(force: tuple[float, float, float], torque: tuple[float, float, float]) -> None:
    felt = reference(Felt()).felt(force, torque)
    assert felt == Wrench(force, torque)
    assert felt.torque_nm is torque


@given(vectors, vectors, st.floats(0.0, 0.02), st.floats(0.0, 6.3))
def test_referred_to_the_tip_the_torque_is_the_contacts_own(
    force: tuple[float, float, float], free: tuple[float, float, float], radius_m: float, angle: float
) -> None:
    # A force at a point of the tip's face and a free torque, read by a sensor that far behind.
    point = np.array([radius_m * np.cos(angle), radius_m * np.sin(angle), 0.0])
    about_tip = np.cross(point, force) + free
    read = np.cross((*point[:2], HEIGHT_MM * 1e-3), force) + free
    x, y, z = read.tolist()
    felt = reference(Felt(torque="tip")).felt(force, (x, y, z))
    assert felt.force_n == force
    assert felt.torque_nm == pytest.approx(about_tip.tolist(), abs=1e-9)


def test_a_stated_lever_is_the_tips_when_it_is_as_long() -> None:
    sample = ((1.0, -2.0, -3.0), (0.25, 0.5, -0.125))
    tip, stated = reference(Felt(torque="tip")), reference(Felt(torque="lever", lever_mm=HEIGHT_MM))
    assert tip.felt(*sample) == stated.felt(*sample)
    behind = reference(Felt(torque="lever", lever_mm=-250.0)).felt(*sample)
    assert behind.torque_nm == pytest.approx((0.25 + 0.5, 0.5 + 0.25, -0.125))
