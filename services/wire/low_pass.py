"""The low-pass of first order that a sensor's samples went through, as numbers: what it does to noise and to a step.

y += share (x - y), with the share that leaves half the power of a wave of ``filter_hz``. Where that is 0 there is no
filter, and every number says so exactly.
"""

from __future__ import annotations

import math

from services.wire.definition_forces import Sensor

MOTION_NS = 20_000_000
"""Time that a motion of the simulator takes: the load goes from one to the next in it, and the filter follows."""

LEAST_HZ = 0.1
"""Least cut-off of a filter: one that is slower shows nothing of a motion."""


def share(sensor: Sensor) -> float:
    """Return the part of the way to the newest sample that the filter goes; 1 without a filter."""
    if sensor.filter_hz < LEAST_HZ or sensor.rate_hz == 0:
        return 1.0
    below = 2.0 * math.sin(math.pi * sensor.filter_hz / sensor.rate_hz) ** 2
    return math.sqrt(below * (below + 2.0)) - below


def motion_samples(sensor: Sensor) -> int:
    """Return how many samples are taken while a motion of the simulator lasts."""
    return max(1, round(sensor.rate_hz * MOTION_NS * 1e-9))


def quieter(sensor: Sensor) -> float:
    """Return the standard deviation of a filtered sample as a part of that before the filter."""
    part = share(sensor)
    return math.sqrt(part / (2.0 - part))


def worth(sensor: Sensor, samples: int) -> float:
    """Return how many independent samples of the same noise have as good a mean as so many filtered ones."""
    keeps = 1.0 - share(sensor)
    if keeps == 0.0:
        return float(samples)
    # Their correlation falls by this factor from sample to sample.
    alike = keeps / (1.0 - keeps) - keeps * (1.0 - keeps**samples) / (samples * (1.0 - keeps) ** 2)
    return samples / (1.0 + 2.0 * alike)


def unfelt(sensor: Sensor) -> float:
    """Return the part of a motion's change of load that the mean of the window does not show yet.

    It is the most that it can be, where motions follow each other at once and each changes the load as much.
    """
    keeps = 1.0 - share(sensor)
    if keeps == 0.0:
        return 0.0
    moving, window = motion_samples(sensor), sensor.window
    behind = keeps * (1.0 - keeps**moving) / (moving * (1.0 - keeps))
    before = behind * keeps**window / (1.0 - keeps ** (moving + window))
    return (behind + before * keeps**moving) * keeps * (1.0 - keeps**window) / (window * (1.0 - keeps))
