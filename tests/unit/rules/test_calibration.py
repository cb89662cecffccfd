"""Six poses in the air give weight, centre of gravity, zero and noise of a simulated sensor, and its residual."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from services.rules.calibration import CalibrationError, Fit, Still, Turned, fit, poses, still
from services.sim.pose import Pose
from services.sim.sensor import SimulatedSensor
from services.sim.world import NO_LOAD, Reading
from services.wire.definition import Definition, Drift, Noise, Tool, Wrist

TRUTH = Definition(
    name="tool",
    noise=Noise(force_n=0.5, torque_nm=0.03),
    tool=Tool(mass_kg=1.2, centre_x_mm=8.0, centre_y_mm=-4.0, centre_z_mm=-50.0, down_x=0.6, down_z=0.8),
    drift=Drift(offset_n=2.0, offset_nm=0.1),
)


def seen(
    definition: Definition = TRUTH, tilt_deg: float = 20.0, seed: int = 1, pressed: int | None = None
) -> list[Still]:
    """Return what the sensor shows in the six poses; in one of them it may press on something."""
    sensor, made = SimulatedSensor(definition, seed), []
    for step, pose in enumerate(poses(tilt_deg)):
        load = Reading((0.0, 0.0, -2.0), (0.0, 0.0, 0.0)) if step == pressed else NO_LOAD
        loads, _ = sensor.samples(load, Pose.from_tilt(0.0, 0.0, 0.0, *pose), 0, step, 2000)
        forces, torques = zip(*loads, strict=True)
        made.append(still(pose, forces, torques))
    return made


@pytest.fixture(scope="module")
def measured() -> Fit:
    return fit(seen(), TRUTH)


def test_weight_and_its_direction_are_measured(measured: Fit) -> None:
    calibration, weight_n = measured.calibration, 1.2 * 9.80665
    assert measured.mass_kg == pytest.approx(1.2, abs=4 * measured.unsure_kg)
    assert measured.unsure_kg < 0.01
    assert calibration.weight_x_n == pytest.approx(0.6 * weight_n, abs=0.1)
    assert calibration.weight_y_n == pytest.approx(0.0, abs=0.1)
    assert calibration.weight_z_n == pytest.approx(0.8 * weight_n, abs=0.1)


def test_the_centre_of_gravity_is_measured_from_the_sensor_s_point(measured: Fit) -> None:
    calibration = measured.calibration
    assert calibration.centre_x_mm == pytest.approx(8.0, abs=1.0)
    assert calibration.centre_y_mm == pytest.approx(-4.0, abs=1.0)
    assert calibration.centre_z_mm == pytest.approx(80.0, abs=1.0)
    assert measured.unsure_mm < 0.5


def test_noise_and_residual_are_what_the_noise_makes_of_them(measured: Fit) -> None:
    calibration = measured.calibration
    assert calibration.sigma_n == pytest.approx(0.5, rel=0.03)
    assert calibration.sigma_nm == pytest.approx(0.03, rel=0.03)
    assert 0.2 * 0.5 / 2000**0.5 < calibration.residual_n < 2.0 * 0.5 / 2000**0.5


def test_a_zero_of_the_sensor_is_told_from_the_weight() -> None:
    quiet = replace(TRUTH, noise=Noise(force_n=1e-6, torque_nm=1e-7))
    shifted, plain = (fit(seen(one), quiet).calibration for one in (quiet, replace(quiet, drift=Drift())))
    assert shifted.weight_z_n == pytest.approx(plain.weight_z_n, abs=1e-4)
    assert plain.zero_fx_n == pytest.approx(0.0, abs=1e-4)
    assert abs(shifted.zero_fx_n) > 0.1


def test_a_sensor_that_is_mounted_turned_gives_the_same_weight() -> None:
    turned = replace(TRUTH, wrist=Wrist(sensor_rx_deg=30.0, sensor_rz_deg=90.0), drift=Drift())
    right = fit(seen(turned), turned).calibration
    assert right.weight_z_n == pytest.approx(0.8 * 1.2 * 9.80665, abs=0.1)
    with pytest.raises(CalibrationError, match="is the sensor mounted as the definition says"):
        fit(seen(turned), replace(turned, wrist=Wrist()))


def test_a_pose_that_presses_on_something_shows_in_the_residual(measured: Fit) -> None:
    assert fit(seen(pressed=3), TRUTH).calibration.residual_n > 10 * measured.calibration.residual_n


def test_a_sensor_without_a_tool_has_a_zero_and_noise() -> None:
    bare = fit(seen(replace(TRUTH, tool=Tool())), TRUTH)
    assert bare.mass_kg == pytest.approx(0.0, abs=0.02)
    assert bare.calibration.sigma_n == pytest.approx(0.5, rel=0.03)


@pytest.mark.parametrize(
    ("shown", "why"),
    [
        (seen()[:3], "expected four or more poses, got 3"),
        ([one._replace(turned=Turned(0, 0, 0)) for one in seen()], "expected poses that are turned differently"),
        ([one._replace(sigma_n=0.0) for one in seen()], "is it dead"),
    ],
)
def test_what_gives_no_calibration_is_refused(shown: list[Still], why: str) -> None:
    with pytest.raises(CalibrationError, match=why):
        fit(shown, TRUTH)
