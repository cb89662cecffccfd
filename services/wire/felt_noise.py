"""How noisy what is felt is, and from which force on contact counts: by a sample's noise and how many there are."""

from __future__ import annotations

import math

from services.wire.definition import Definition
from services.wire.low_pass import quieter, worth


def sample_sigma_n(definition: Definition) -> float:
    """Return the standard deviation of a force component of a single sample as it is read [N].

    It is the measured one, or the simulator's, which is that before the filter.
    """
    noise, calibration = definition.noise, definition.calibration
    return calibration.sigma_n if calibration.made else noise.scale * noise.force_n * quieter(definition.sensor)


def window_sigma_n(definition: Definition) -> float:
    """Return the standard deviation of a force component of the mean of a window [N]."""
    return sample_sigma_n(definition) / math.sqrt(worth(definition.sensor, definition.sensor.window))


def felt_sigma_n(definition: Definition) -> float:
    """Return the standard deviation of a force component of what is felt [N].

    That is of the mean of a window less the zero, which is itself a mean of samples.
    """
    sensor = definition.sensor
    parts = 1.0 / worth(sensor, sensor.window)
    if sensor.tare_samples:
        parts += 1.0 / worth(sensor, sensor.tare_samples)
    return sample_sigma_n(definition) * math.sqrt(parts)


def contact_force_n(definition: Definition) -> float:
    """Return the force [N] at or above which there is contact."""
    sigmas = definition.sensor.contact_sigmas
    return max(definition.limits.contact_force_n, sigmas * felt_sigma_n(definition))
