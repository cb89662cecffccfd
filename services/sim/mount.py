"""How the sensor's axes stand to the tool's: as the definition says, or turned in a way that nobody is told.

Only the axes are turned: torques refer to the same point as ever, ``wrist.sensor_height_mm`` behind the tip.
"""

from __future__ import annotations

from services.rules.quaternion import Quaternion
from services.sim.pose import Vector, conjugate, from_angles, normalised, rotate
from services.wire.definition import Wrist
from services.wire.randomness import Role, generator

_ALIGNED: Quaternion = (1.0, 0.0, 0.0, 0.0)


class Mount:
    """The turn of one run's sensor."""

    def __init__(self, wrist: Wrist, seed: int) -> None:
        """Take the turn from the definition, or draw it: each of SO(3) is as likely; a seed always has the same."""
        self.orientation = _drawn(seed) if wrist.sensor_mount == "unknown" else _given(wrist)
        """Unit quaternion (w, x, y, z) that turns sensor axes into tool axes."""
        self._back = conjugate(self.orientation)
        self._aligned = self.orientation == _ALIGNED

    def seen(self, load: Vector) -> Vector:
        """Return a force or torque, shape (3,), of the tool frame along the axes of the sensor."""
        return load if self._aligned else rotate(self._back, load)


def _given(wrist: Wrist) -> Quaternion:
    return from_angles(wrist.sensor_rx_deg, wrist.sensor_ry_deg, wrist.sensor_rz_deg)


def _drawn(seed: int) -> Quaternion:
    # Four normal numbers have no preferred direction in four dimensions, so the unit quaternion along them has none.
    w, x, y, z = generator(seed, Role.SENSOR_MOUNT, 0, 0).standard_normal(4).tolist()
    return normalised((w, x, y, z))
