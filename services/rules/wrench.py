"""What classifier, reward and learner take for felt: a force/torque sample, its torque referred to a point. Pure.

A sensor far behind the tip reads a lateral force twice: as a force, and as a torque that is that force times the lever.
Referred to the tip, only what the contact itself turns with is left: T' = T - r x F, with r from the sensor to the
point, along +Z of the tool frame.
"""

from __future__ import annotations

from typing import NamedTuple

from services.wire.definition import Definition
from services.wire.messages import Force, Torque


class Wrench(NamedTuple):
    """A force and a torque, in the tool frame."""

    force_n: Force
    torque_nm: Torque


class Reference:
    """The point that one definition refers torques to."""

    def __init__(self, definition: Definition) -> None:
        felt = definition.felt
        levers = {"as_read": 0.0, "tip": definition.wrist.sensor_height_mm, "lever": felt.lever_mm}
        self.lever_m = levers[felt.torque] * 1e-3
        """How far the point is ahead of the sensor, towards the tip; 0 for torques as they are read."""

    def felt(self, force_n: Force, torque_nm: Torque) -> Wrench:
        """Return a sample [N], [N m] as it is read, with its torque referred to the point."""
        if self.lever_m == 0.0:
            return Wrench(force_n, torque_nm)
        fx, fy, _ = force_n
        tx, ty, tz = torque_nm
        return Wrench(force_n, (tx + self.lever_m * fy, ty - self.lever_m * fx, tz))
