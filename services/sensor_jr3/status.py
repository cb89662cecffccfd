"""The card's error and warning bits as ``FtPacket.status``. Pure."""

from __future__ import annotations

from services.sensor_jr3 import memory_map as jr3

SATURATED, NEAR_SATURATION, LOST, CHANGED, NOT_ZEROED = 1, 2, 4, 8, 16

_NAMES = {
    jr3.RAM_BAD: "the card's memory is bad",
    jr3.BUSY: "the card is busy",
    jr3.CALIBRATION_BAD: "the sensor's calibration has not come in well",
    jr3.WATCHDOG2: "no data or clock from the sensor (watchdog 2)",
    jr3.WATCHDOG: "no data from the sensor (watchdog)",
}
USELESS = sum(_NAMES)
"""Error bits with which no force is known."""


def status_of(warnings: int, errors: int) -> int:
    """Return the status bits of a sample. A busy card, as in another program's command, has no force data either."""
    return (
        SATURATED * bool(errors & jr3.AXIS_BITS)
        | NEAR_SATURATION * bool(warnings & jr3.AXIS_BITS)
        | LOST * bool(errors & USELESS)
        | CHANGED * bool(errors & jr3.SENSOR_CHANGED)
    )


def troubles(errors: int) -> str:
    """Return in words which of the error bits say that no force is known; empty for none."""
    return ", ".join(name for bit, name in _NAMES.items() if errors & bit)
