"""Pure pose arithmetic: where the peg's tip is in the hole frame, and the increments that move it.

Frames as in ``services.wire.definition``: hole frame with its origin in the centre of the mouth and +Z into the hole;
tool frame at the centre of the peg's tip, +Z along the peg. Millimetres and degrees outside, quaternions (w, x, y, z)
inside. Everything is plain double arithmetic in a fixed order, so the same increments give the same bits anywhere on
one machine.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from services.rules.quaternion import Quaternion, multiply
from services.wire.actions import Increment

Vector = tuple[float, float, float]


class Pose(NamedTuple):
    """Position of the tip [mm] and orientation of the tool frame (unit quaternion), both in the hole frame."""

    x_mm: float
    y_mm: float
    z_mm: float
    qw: float = 1.0
    qx: float = 0.0
    qy: float = 0.0
    qz: float = 0.0

    @classmethod
    def from_tilt(
        cls, x_mm: float, y_mm: float, z_mm: float, rx_deg: float = 0.0, ry_deg: float = 0.0, rz_deg: float = 0.0
    ) -> Pose:
        """Pose with its tip at (x, y, z) and the orientation R = Rz(rz) Ry(ry) Rx(rx)."""
        return cls(x_mm, y_mm, z_mm, *from_angles(rx_deg, ry_deg, rz_deg))

    @property
    def position(self) -> Vector:
        """Tip in the hole frame [mm], shape (3,)."""
        return (self.x_mm, self.y_mm, self.z_mm)

    @property
    def orientation(self) -> Quaternion:
        """Unit quaternion (w, x, y, z) that turns tool axes into hole axes."""
        return (self.qw, self.qx, self.qy, self.qz)

    def moved(self, increment: Increment, centre_mm: float = 0.0) -> Pose:
        """The pose after one increment in this pose's own tool frame; it turns ``centre_mm`` behind the tip."""
        dx, dy, dz = rotate(self.orientation, increment[:3])
        if increment[3:] == (0.0, 0.0, 0.0):
            return Pose(self.x_mm + dx, self.y_mm + dy, self.z_mm + dz, *self[3:])
        turned = normalised(multiply(self.orientation, from_angles(*increment[3:])))
        if centre_mm:
            # The centre makes the shift, and the tip is as far before it as it was, along the axis as it is then.
            before, after = axis(self.orientation), axis(turned)
            dx, dy, dz = (d + centre_mm * (a - b) for d, a, b in zip((dx, dy, dz), after, before, strict=True))
        return Pose(self.x_mm + dx, self.y_mm + dy, self.z_mm + dz, *turned)

    def point(self, along_mm: float) -> Vector:
        """Point of the tool's Z axis, ``along_mm`` from the tip towards insertion, in the hole frame [mm]."""
        px, py, pz, w, x, y, z = self
        return (
            px + along_mm * (2.0 * (x * z + w * y)),
            py + along_mm * (2.0 * (y * z - w * x)),
            pz + along_mm * (1.0 - 2.0 * (x * x + y * y)),
        )


def require_finite(subject: str, values: tuple[float, ...]) -> None:
    """Refuse NaN and infinities.

    Raises:
        ValueError: if any value is not finite; names the subject and shows the values.
    """
    if not all(map(math.isfinite, values)):
        raise ValueError(f"{subject}: expected finite numbers, got {tuple(values)}")


def normalised(q: Quaternion) -> Quaternion:
    """The unit quaternion along ``q``; keeps rounding from adding up over many moves."""
    w, x, y, z = q
    size = math.sqrt(w * w + x * x + y * y + z * z)
    return (w / size, x / size, y / size, z / size)


def conjugate(q: Quaternion) -> Quaternion:
    """The inverse rotation of a unit quaternion."""
    return (q[0], -q[1], -q[2], -q[3])


def from_angles(rx_deg: float, ry_deg: float, rz_deg: float) -> Quaternion:
    """Unit quaternion of R = Rz(rz) Ry(ry) Rx(rx), angles in degrees."""
    half_x, half_y, half_z = math.radians(rx_deg) / 2, math.radians(ry_deg) / 2, math.radians(rz_deg) / 2
    about_x = (math.cos(half_x), math.sin(half_x), 0.0, 0.0)
    about_y = (math.cos(half_y), 0.0, math.sin(half_y), 0.0)
    about_z = (math.cos(half_z), 0.0, 0.0, math.sin(half_z))
    return multiply(about_z, multiply(about_y, about_x))


def rotate(q: Quaternion, v: tuple[float, ...]) -> Vector:
    """Vector ``v``, shape (3,), turned by the unit quaternion ``q``."""
    w, x, y, z = q
    vx, vy, vz = v
    # t = 2 q x v, result = v + w t + q x t: the shortest form without building a matrix.
    tx = 2.0 * (y * vz - z * vy)
    ty = 2.0 * (z * vx - x * vz)
    tz = 2.0 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )


def axis(q: Quaternion) -> Vector:
    """Direction of the tool's Z axis in the hole frame, unit vector of shape (3,)."""
    w, x, y, z = q
    return (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))


def rotation_vector(q: Quaternion) -> Vector:
    """Axis times angle [rad], shape (3,), of a unit quaternion; the shorter of the two ways round."""
    w, x, y, z = q
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    # Near the identity angle / sin(angle/2) tends to 2 and must not be computed as 0 / 0.
    factor = 2.0 if sine < 1e-9 else 2.0 * math.atan2(sine, w) / sine
    return (factor * x, factor * y, factor * z)


def way(start: Pose, end: Pose, steps: int, along_mm: float) -> list[tuple[float, ...]]:
    """Where a point of the tool's Z axis is after each of ``steps`` equal parts of the way between two poses.

    The tip goes on a straight line and the orientation turns at a constant rate. Meant for the small angles of one
    increment, where the normalised linear blend of quaternions is that rate. Returns for each part but the last, whose
    pose is ``end`` itself, position [mm] and quaternion (w, x, y, z), shape (steps - 1, 7); ``along_mm`` is as in
    ``Pose.point``.
    """
    x0, y0, z0, w0, i0, j0, k0 = start
    x1, y1, z1, w1, i1, j1, k1 = end
    near = w0 * w1 + i0 * i1 + j0 * j1 + k0 * k1 >= 0.0
    passed = list[tuple[float, ...]]()
    # Written out, as this is done for every time step of the physics.
    for part in range(1, steps):
        fraction = part / steps
        keep = 1.0 - fraction
        blend = fraction if near else -fraction
        w, i = keep * w0 + blend * w1, keep * i0 + blend * i1
        j, k = keep * j0 + blend * j1, keep * k0 + blend * k1
        size = math.sqrt(w * w + i * i + j * j + k * k)
        w, i, j, k = w / size, i / size, j / size, k / size
        passed.append(
            (
                keep * x0 + fraction * x1 + along_mm * (2.0 * (i * k + w * j)),
                keep * y0 + fraction * y1 + along_mm * (2.0 * (j * k - w * i)),
                keep * z0 + fraction * z1 + along_mm * (1.0 - 2.0 * (i * i + j * j)),
                w,
                i,
                j,
                k,
            )
        )
    return passed
