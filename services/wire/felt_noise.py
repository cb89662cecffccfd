"""How noisy what is felt is, and from which force on contact counts: by a sample's noise and how many there are."""

from __future__ import annotations

import math

from services.wire.definition import Definition


def sample_sigma_n(definition: Definition) -> float:
    """Return the standard deviation of a force component of a single sample [N]: measured, or the simulator's."""
    noise, calibration = definition.noise, definition.calibration
    return calibration.sigma_n if calibration.made else noise.scale * noise.force_n


def felt_sigma_n(definition: Definition) -> float:
    """Return the standard deviation of a force component of what is felt [N].

    That is of the mean of a window less the zero, which is itself a mean of samples.
    """
    sensor = definition.sensor
    parts = 1.0 / sensor.window + (1.0 / sensor.tare_samples if sensor.tare_samples else 0.0)
    return sample_sigma_n(definition) * math.sqrt(parts)


def contact_force_n(definition: Definition) -> float:
    """Return the force [N] at or above which there is contact."""
    sigmas = definition.sensor.contact_sigmas
    return max(definition.limits.contact_force_n, sigmas * felt_sigma_n(definition))
