"""Contradictions among the keys about what is done to a sensor's samples."""

from __future__ import annotations

import math

from services.wire.definition import Calibration, Definition
from services.wire.felt_noise import contact_force_n, sample_sigma_n
from services.wire.low_pass import LEAST_HZ

_SHORTEST = 0.1


def force_rules(definition: Definition) -> tuple[tuple[bool, str, str], ...]:
    """Return the rules about what is done to samples: whether each holds, the key, and the complaint."""
    sensor, calibration, tool, limits = definition.sensor, definition.calibration, definition.tool, definition.limits
    contact_n, most_n = contact_force_n(definition), limits.collision_force_n
    down, measured = math.hypot(tool.down_x, tool.down_y, tool.down_z), sample_sigma_n(definition) > 0.0
    return (
        (
            sensor.filter_hz == 0.0 or LEAST_HZ <= sensor.filter_hz < sensor.rate_hz / 2,
            "sensor.filter_hz",
            f"expected 0, or from {LEAST_HZ} to less than half of sensor.rate_hz = {sensor.rate_hz}, got "
            f"{sensor.filter_hz}",
        ),
        (
            sensor.tare_samples == 0 or sensor.tare_samples >= sensor.window,
            "sensor.tare_samples",
            f"expected 0 or at least sensor.window = {sensor.window}, got {sensor.tare_samples}",
        ),
        (
            sensor.tare_samples == 0 or calibration.made,
            "sensor.tare_samples",
            f"expected 0 without a calibration (`treenail tare` makes one), got {sensor.tare_samples}",
        ),
        (
            sensor.contact_sigmas == 0.0 or measured,
            "sensor.contact_sigmas",
            f"expected 0 without a calibration (`treenail tare` makes one) or noise, got {sensor.contact_sigmas}",
        ),
        (
            contact_n < most_n,
            "sensor.contact_sigmas",
            f"expected contact from less than limits.collision_force_n = {most_n}, got from {contact_n:.3f} N",
        ),
        (
            calibration.residual_n <= contact_n / 2,
            "calibration.residual_n",
            f"expected at most half of the {contact_n:.3f} N that contact counts from, got {calibration.residual_n}",
        ),
        (
            definition.wrist.sensor_mount == "given" or calibration == Calibration(),
            "calibration.sigma_n",
            "expected no calibration of a sensor whose mounting is not known (wrist.sensor_mount)",
        ),
        (down >= _SHORTEST, "tool.down_z", f"expected a direction at least {_SHORTEST} long, got one {down:.3g} long"),
    )
