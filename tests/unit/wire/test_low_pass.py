"""The filter's numbers: half the power at its cut-off, what noise and a step come to, and nothing without one."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from msgspec.structs import replace

from services.sim.low_pass import LowPass
from services.wire.definition import Calibration, Definition, Noise, Sensor
from services.wire.definition_file import definition_sha256, load
from services.wire.definition_rules import contradiction
from services.wire.felt_noise import felt_sigma_n, sample_sigma_n, window_sigma_n
from services.wire.force_bound import ForceBound
from services.wire.low_pass import motion_samples, quieter, share, unfelt, worth

JR3 = Sensor(window=64, rate_hz=1000, filter_hz=31.25)
SINGLE = replace(JR3, window=1)


@pytest.mark.parametrize("filter_hz", [0.5, 31.25, 400.0])
def test_a_wave_of_the_cut_off_loses_half_its_power(filter_hz: float) -> None:
    part = share(replace(JR3, filter_hz=filter_hz))
    gain = part / (1 - (1 - part) * cmath.exp(-2j * math.pi * filter_hz / 1000))
    assert abs(gain) == pytest.approx(math.sqrt(0.5))
    assert 0 < part < 1


def test_without_a_filter_nothing_is_changed_to_the_last_bit() -> None:
    plain = replace(JR3, filter_hz=0.0)
    assert (share(plain), quieter(plain), worth(plain, 64), unfelt(plain)) == (1.0, 1.0, 64.0, 0.0)
    noisy = load("suite-noisy")
    assert window_sigma_n(noisy) == 1.0 / math.sqrt(64)
    assert definition_sha256(replace(noisy, sensor=replace(noisy.sensor, filter_hz=0.0))) == definition_sha256(noisy)
    assert definition_sha256(replace(noisy, sensor=JR3)) != definition_sha256(noisy)


def filtered(sensor: Sensor, noise: np.ndarray) -> np.ndarray:
    """Return the samples of a load of 0 that has stood for long, shape (samples - 1,)."""
    low_pass = LowPass(sensor)
    rows = [[error] + [0.0] * 5 for error in noise.tolist()]
    return np.array(low_pass.read((0.0,) * 6, rows, True))[:, 0]


def test_noise_is_as_much_less_and_as_alike_as_is_said() -> None:
    samples = filtered(JR3, np.random.default_rng(5).standard_normal(64 * 4000))
    assert samples.std() == pytest.approx(quieter(JR3), rel=0.02)
    means = samples[: len(samples) // 64 * 64].reshape(-1, 64).mean(axis=1)
    assert means.std() == pytest.approx(quieter(JR3) / math.sqrt(worth(JR3, 64)), rel=0.05)
    assert 6.0 < worth(JR3, 64) < 8.0
    firsts = [filtered(JR3, noise)[0] for noise in np.random.default_rng(6).standard_normal((4000, 2))]
    assert np.std(firsts) == pytest.approx(quieter(JR3), rel=0.05), "an episode begins as noisy as it goes on"
    assert worth(JR3, 1) == pytest.approx(1.0)


@pytest.mark.parametrize("sensor", [JR3, SINGLE, replace(JR3, filter_hz=2.0), replace(JR3, rate_hz=8000)])
def test_what_is_not_felt_yet_is_what_was_worked_out(sensor: Sensor) -> None:
    """Each motion adds 1: in the end the window is as far behind as ``unfelt`` says."""
    low_pass, still = LowPass(sensor), [[0.0] * 6]
    low_pass.read((0.0,) * 6, still * (low_pass.before(True) + sensor.window), True)
    behind = 0.0
    for load_n in range(1, 60):
        rows = still * (motion_samples(sensor) + sensor.window)
        read = low_pass.read((float(load_n),) * 6, rows, False)
        assert len(read) == sensor.window
        behind = load_n - float(np.mean(read))
    assert behind == pytest.approx(unfelt(sensor))


def test_a_slow_filter_widens_what_the_guard_allows_for() -> None:
    noisy = load("suite-noisy")
    plain, slow = (ForceBound(replace(noisy, sensor=replace(SINGLE, filter_hz=hz))) for hz in (0.0, 2.0))
    assert slow.largest_n > plain.largest_n - 5 * math.sqrt(2) * noisy.noise.force_n
    quiet = replace(noisy, noise=Noise())
    plain, slow = (ForceBound(replace(quiet, sensor=replace(SINGLE, filter_hz=hz))) for hz in (0.0, 31.25))
    assert slow.largest_n - plain.largest_n == pytest.approx(unfelt(SINGLE) * (plain.largest_n - 0.5))


def test_noise_that_was_measured_is_that_of_filtered_samples() -> None:
    definition = replace(load("suite-noisy"), sensor=replace(JR3, tare_samples=256))
    assert sample_sigma_n(definition) == quieter(JR3)
    measured = replace(definition, calibration=Calibration(sigma_n=0.3, sigma_nm=0.02))
    assert sample_sigma_n(measured) == 0.3
    assert felt_sigma_n(measured) == pytest.approx(0.3 * math.sqrt(1 / worth(JR3, 64) + 1 / worth(JR3, 256)))


@pytest.mark.parametrize(("filter_hz", "rate_hz"), [(31.25, 0), (500.0, 1000), (31.25, 60), (1e-300, 1000)])
def test_a_filter_needs_a_rate_of_more_than_twice_its_cut_off(filter_hz: float, rate_hz: int) -> None:
    conflict = contradiction(Definition(name="x", sensor=Sensor(filter_hz=filter_hz, rate_hz=rate_hz)))
    assert conflict is not None and conflict[0] == "sensor.filter_hz"
    assert conflict[1] == f"expected 0, or from 0.1 to less than half of sensor.rate_hz = {rate_hz}, got {filter_hz}"
