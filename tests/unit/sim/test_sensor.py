"""The simulated sensor: gravity by orientation and a zero that wanders, as functions of seed, episode and step."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace

from services.sim.pose import Pose
from services.sim.sensor import Samples, SimulatedSensor
from services.sim.world import NO_LOAD, Reading
from services.wire.definition import Definition, Drift, Noise, Sensor, Tool

HEAVY = Definition(name="heavy", tool=Tool(mass_kg=0.5, centre_x_mm=10.0, centre_z_mm=-60.0))
WEIGHT_N = 0.5 * 9.80665


def shown(definition: Definition, pose: Pose, episode: int = 0, step: int = 0, seed: int = 0) -> np.ndarray:
    """Return the one sample of a sensor without noise."""
    loads, _ = SimulatedSensor(definition, seed).samples(NO_LOAD, pose, episode, step)
    (load,) = loads
    return np.array([*load[0], *load[1]])


def test_half_a_kilogram_pulls_an_upright_tool_into_the_hole() -> None:
    """About the sensor, 130 mm behind the tip, the centre of gravity is 10 mm aside: 0.049 N m about Y."""
    assert shown(HEAVY, Pose(0, 0, -5)) == pytest.approx([0, 0, WEIGHT_N, 0, -0.01 * WEIGHT_N, 0])


def test_three_degrees_shift_a_reading_by_a_quarter_of_a_newton() -> None:
    aside = shown(HEAVY, Pose.from_tilt(0, 0, -5, 3.0)) - shown(HEAVY, Pose(0, 0, -5))
    assert aside[1] == pytest.approx(WEIGHT_N * math.sin(math.radians(3.0)))
    assert np.linalg.norm(aside[:3]) == pytest.approx(0.257, abs=0.001)
    assert aside[3] == pytest.approx(-0.07 * aside[1]), "the centre of gravity is 70 mm before the sensor"


def test_down_is_where_the_definition_says() -> None:
    sideways = replace(HEAVY, tool=replace(HEAVY.tool, down_x=-0.5, down_z=0.0))
    assert shown(sideways, Pose(0, 0, -5))[:3] == pytest.approx([-WEIGHT_N, 0, 0])


def test_weight_adds_to_what_the_peg_feels() -> None:
    sensor, load = SimulatedSensor(HEAVY, 0), Reading((1.0, 2.0, -3.0), (0.1, 0.2, 0.3))
    (felt,), _ = sensor.samples(load, Pose(0, 0, -5), 0, 0)
    assert felt[0] == pytest.approx((1.0, 2.0, WEIGHT_N - 3.0))
    assert felt[1] == pytest.approx((0.1, 0.2 - 0.01 * WEIGHT_N, 0.3))


def test_the_zero_walks_from_episode_to_episode_whichever_are_simulated() -> None:
    walking = Definition(name="walking", drift=Drift(walk_n=0.5, walk_nm=0.1))
    through = SimulatedSensor(walking, 3)
    zeros = [through.samples(NO_LOAD, Pose(0, 0, -5), episode, 0)[0][0] for episode in range(40)]
    for episode in (39, 7, 0, 21):
        assert SimulatedSensor(walking, 3).samples(NO_LOAD, Pose(0, 0, -5), episode, 0)[0][0] == zeros[episode]
        assert through.samples(NO_LOAD, Pose(0, 0, -5), episode, 0)[0][0] == zeros[episode]
    steps = np.diff([zero[0] for zero in zeros], axis=0)
    assert zeros[0] == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert steps.std() == pytest.approx(0.5, rel=0.2)


def test_the_zero_goes_as_far_as_it_is_told_in_a_thousand_motions() -> None:
    ramp = Definition(name="ramp", drift=Drift(ramp_n=2.0, ramp_nm=0.25))
    there, halfway = (shown(ramp, Pose(0, 0, -5), 4, step, seed=2) for step in (1000, 500))
    assert np.linalg.norm(there[:3]) == pytest.approx(2.0)
    assert np.linalg.norm(there[3:]) == pytest.approx(0.25)
    assert halfway == pytest.approx(there / 2)
    assert shown(ramp, Pose(0, 0, -5), 4, 0, seed=2) == pytest.approx(np.zeros(6))


def test_a_run_begins_with_a_zero_of_its_own() -> None:
    offset = Definition(name="offset", drift=Drift(offset_n=1.0, offset_nm=0.1))
    zeros = np.array([shown(offset, Pose(0, 0, -5), seed=seed) for seed in range(200)])
    assert zeros[:, :3].std() == pytest.approx(1.0, rel=0.1)
    assert zeros[:, 3:].std() == pytest.approx(0.1, rel=0.1)


def test_a_heavy_tool_can_saturate_a_small_sensor() -> None:
    small = replace(HEAVY, sensor=Sensor(full_scale_n=20, full_scale_dnm=10), tool=Tool(mass_kg=5.0))
    _, saturated = SimulatedSensor(small, 0).samples(NO_LOAD, Pose(0, 0, -5), 0, 0)
    assert saturated


FILTERED = Definition(
    name="filtered", sensor=Sensor(window=3, rate_hz=1000, filter_hz=31.25), noise=Noise(force_n=0.1, torque_nm=0.01)
)


def motions(sensor: SimulatedSensor, episode: int, loads_n: list[float]) -> list[tuple[Samples, bool]]:
    """Return what is shown of an episode whose motions bring these loads, the first of them home."""
    return [
        sensor.samples(Reading((load_n, 0.0, 0.0), (0.0, 0.0, 0.0)), Pose(0, 0, -5), episode, step)
        for step, load_n in enumerate(loads_n)
    ]


def test_behind_a_filter_a_load_comes_late_and_in_full() -> None:
    still = replace(FILTERED, noise=Noise())
    home, late, later = (
        [force[0] for force, _ in loads] for loads, _ in motions(SimulatedSensor(still, 0), 0, [0.0, 3.0, 3.0])
    )
    assert home == [0.0] * 3
    assert len(late) == 3 and 2.0 < late[0] < late[1] < late[2] < 2.9
    assert later[-1] == pytest.approx(3.0, abs=0.03)


def test_what_a_filter_shows_depends_on_the_episode_s_motions_alone() -> None:
    """A cell that was killed is brought back by the same home and the same motions."""
    through, loads_n = SimulatedSensor(FILTERED, 3), [0.0, 1.0, 5.0, 2.0]
    first = motions(through, 0, loads_n)
    second = motions(through, 1, loads_n)
    assert motions(through, 0, loads_n) == first != second
    assert motions(SimulatedSensor(FILTERED, 3), 1, loads_n) == second
    assert motions(SimulatedSensor(FILTERED, 3), 1, [0.0, 9.0, 5.0, 2.0])[1:] != second[1:]
