"""Poses against the emulator's own arithmetic, and packets of the controller as a sensor's."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.bus.frames import GRID, frame, increment_of
from services.robot_ur.poses import from_ur, to_ur
from services.robot_ur.states import PLAYING, State, trouble
from services.robot_ur.wrist import ControllerClock, Wrist
from services.rules.ft_counts import FtCounts
from services.rules.mount import Mount
from services.rules.poses import Pose, apart, from_quaternion, from_rotation_vector, quaternion, rotation_vector
from services.wire.actions import Increment

ANGLE = st.floats(-3.0, 3.0)
PLACE = st.floats(-1.0, 1.0)
STEP = st.integers(-4000, 4000).map(lambda number: number / 10**GRID)
DAY_NS = 1_764_000_000 * 10**9
MS = 10**6


@given(st.tuples(PLACE, PLACE, PLACE, ANGLE, ANGLE, ANGLE), st.tuples(STEP, STEP, STEP, STEP, STEP, STEP))
def test_the_emulator_finds_the_very_numbers_of_an_increment(pose: tuple[float, ...], step: tuple[float, ...]) -> None:
    goal = to_ur(from_ur(pose).after(Increment(*step)))
    assert increment_of(frame(pose), frame(goal)) == Increment(*(value + 0.0 for value in step))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 1.0, 3.1, math.pi - 1e-9, math.pi])
@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.6, 0.0, -0.8), (-0.48, 0.64, 0.6)])
def test_a_rotation_vector_and_back_also_half_a_turn(angle: float, axis: tuple[float, float, float]) -> None:
    x, y, z = (angle * part for part in axis)
    turn = from_rotation_vector((x, y, z))
    assert np.allclose(turn, frame((0.0, 0.0, 0.0, x, y, z))[:3, :3], atol=1e-12)
    assert np.allclose(from_rotation_vector(rotation_vector(turn)), turn, atol=1e-8)
    assert np.allclose(from_quaternion(quaternion(turn)), turn, atol=1e-8)


def test_how_far_two_poses_are_apart() -> None:
    pose = from_ur((0.1, -0.4, 0.2, 2.3, -1.9, 0.2))
    away_mm, turned_deg = apart(pose, pose.after(Increment(dx_mm=3.0, dy_mm=4.0, rz_deg=0.5)))
    assert away_mm == pytest.approx(5.0)
    assert turned_deg == pytest.approx(0.5)


def state(t_s: float, force: tuple[float, ...] = (0.0,) * 6, pose: Pose | None = None) -> State:
    raw = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    return State(t_s, pose or from_ur((0.0,) * 6), 0.0, force, raw, 7, 1, PLAYING, 0.0, (0.0,) * 3)


def test_what_the_wrist_feels_is_in_the_tool_frame_and_on_the_grid_of_counts() -> None:
    pose = from_ur((0.1, -0.4, 0.2, 2.31, -1.94, 0.17))
    counts = FtCounts("1", (200, 200, 200, 120, 120, 120))
    felt = counts.quantised((1.1, -2.2, 3.3), (0.01, -0.02, 0.03))
    turn = frame((0.1, -0.4, 0.2, 2.31, -1.94, 0.17))[:3, :3]
    wrist = Wrist("tcp", Mount(), 125.0)
    wrist.counts = counts
    packet = wrist.take(state(1.0, (*(turn @ felt[0]), *(turn @ felt[1])), pose), DAY_NS)
    assert (packet.force_n[-1], packet.torque_nm[-1]) == felt[:2], "to the last bit"
    raw = Wrist("raw", Mount(), 125.0).take(state(1.0), DAY_NS)
    assert (raw.force_n[-1], raw.torque_nm[-1]) == ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))


def test_times_are_the_controller_s_and_gaps_are_counted() -> None:
    wrist = Wrist("tcp", Mount(), 125.0)
    packets = [wrist.take(state(t_s), DAY_NS + late) for t_s, late in ((5.0, 0), (5.008, 50 * MS), (5.032, 90 * MS))]
    assert [packet.t_ns - packets[0].t_ns for packet in packets] == [0, 8 * MS, 32 * MS]
    assert [packet.sequence - packets[0].sequence for packet in packets] == [0, 1, 4]
    assert wrist.lost == 2


def test_a_wrist_that_is_gone_says_so_and_goes_on_later() -> None:
    wrist = Wrist("tcp", Mount(), 125.0)
    before = wrist.take(state(5.0, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)), DAY_NS)
    gone = wrist.gone(DAY_NS - 10**9)
    wrist.begin()
    after = wrist.take(state(0.1), DAY_NS)
    assert (before.status, gone.status, after.status) == (0, 4, 0)
    assert gone.force_n == before.force_n
    assert before.t_ns < gone.t_ns < after.t_ns
    assert before.sequence < gone.sequence < after.sequence


def test_a_clock_may_be_late_but_not_jump() -> None:
    clock = ControllerClock()
    assert clock.complaint(5.0, 100.0) is None
    assert clock.complaint(5.008, 103.0) is None, "a packet that waited"
    assert clock.complaint(8.0, 103.01) is None, "those behind it come at once"
    assert "+0.990" in str(clock.complaint(9.1, 103.11))
    clock.begin()
    assert clock.complaint(5.0, 104.0) is None
    assert "-0.500" in str(clock.complaint(4.5, 104.5))


@pytest.mark.parametrize(
    ("modes", "words"),
    [
        ((7, 1), None),
        ((7, 2), None),
        ((7, 3), "protective stop"),
        ((3, 7), "emergency stop: release the button"),
        ((3, 1), "arm power is off"),
        ((5, 1), "brakes"),
        ((7, 42), "safety mode 42, which is not known here"),
        ((-7, 1), "robot mode -7, which is not known here"),
    ],
)
def test_what_keeps_the_arm_from_moving(modes: tuple[int, int], words: str | None) -> None:
    why = trouble(state(0.0)._replace(robot_mode=modes[0], safety_mode=modes[1]))
    assert why is None if words is None else words in str(why)
