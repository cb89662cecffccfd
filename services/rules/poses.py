"""Where a tool is in a robot's base frame, or the hole's, and the increments that move it. Pure; millimetres, degrees.

Controllers have a rotation vector [rad] or a quaternion. Each goal of an arm follows from the goal before, never from
where it was measured to be: its last micrometres do not add up, and the same increments give the same goals.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from services.rules.quaternion import Quaternion
from services.rules.workspace import Matrix, Vector, product, rotation, turned
from services.wire.actions import Increment

_SMALL = 1e-12


class Pose(NamedTuple):
    """A place of the tool."""

    position_mm: Vector
    turn: Matrix
    """Tool axes in that frame, row by row."""

    def after(self, increment: Increment, centre_mm: float = 0.0) -> Pose:
        """Return the pose after one increment in this pose's own tool frame; it turns ``centre_mm`` behind the tip."""
        shift = turned(self.turn, increment[:3])
        x, y, z = (a + b for a, b in zip(self.position_mm, shift, strict=True))
        if increment[3:] == (0.0, 0.0, 0.0):
            return Pose((x, y, z), self.turn)
        turn = product(self.turn, rotation(*increment[3:]))
        if centre_mm:
            # The tip swings about a point behind it: it is the axis, the last column, that says by how much.
            swung = (centre_mm * (new[2] - old[2]) for new, old in zip(turn, self.turn, strict=True))
            x, y, z = (at + by for at, by in zip((x, y, z), swung, strict=True))
        return Pose((x, y, z), turn)

    def in_tool(self, vector: Sequence[float]) -> Vector:
        """Return a vector of that frame along the tool's axes."""
        a, b, c = vector
        x, y, z = (column[0] * a + column[1] * b + column[2] * c for column in zip(*self.turn, strict=True))
        return x, y, z


def apart(one: Pose, other: Pose) -> tuple[float, float]:
    """Return how far two poses are apart [mm], and turned [deg]."""
    away_mm = math.dist(one.position_mm, other.position_mm)
    between = product(_transposed(one.turn), other.turn)
    return away_mm, math.degrees(math.hypot(*rotation_vector(between)))


def from_rotation_vector(vector: Vector) -> Matrix:
    """Return the matrix of axis times angle [rad]."""
    angle = math.hypot(*vector)
    if angle < _SMALL:
        return ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    x, y, z = (value / angle for value in vector)
    s, c = math.sin(angle), math.cos(angle)
    v = 1.0 - c
    return (
        (c + x * x * v, x * y * v - z * s, x * z * v + y * s),
        (y * x * v + z * s, c + y * y * v, y * z * v - x * s),
        (z * x * v - y * s, z * y * v + x * s, c + z * z * v),
    )


def rotation_vector(turn: Matrix) -> Vector:
    """Return axis times angle [rad], the shorter way round."""
    w, x, y, z = _quaternion(turn)
    sine = math.hypot(x, y, z)
    factor = 0.0 if sine == 0.0 else 2.0 * math.atan2(sine, w) / sine
    return factor * x, factor * y, factor * z


def quaternion(turn: Matrix) -> Quaternion:
    """Return the unit quaternion w, x, y, z of a matrix, with w not below 0."""
    w, x, y, z = _quaternion(turn)
    length = math.hypot(w, x, y, z)
    return w / length, x / length, y / length, z / length


def from_quaternion(quaternion: Quaternion) -> Matrix:
    """Return the matrix of a unit quaternion w, x, y, z; one that is a little longer or shorter is taken for one."""
    length = math.hypot(*quaternion)
    w, x, y, z = (part / length for part in quaternion)
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
        (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
        (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
    )


def _quaternion(turn: Matrix) -> Quaternion:
    """Return some multiple of the quaternion, by its largest part, so also near half a turn; w is not below 0."""
    (a, b, c), (d, e, f), (g, h, i) = turn
    squares = (1.0 + a + e + i, 1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i)
    largest = max(range(4), key=squares.__getitem__)
    w, x, y, z = (
        (squares[0], h - f, c - g, d - b),
        (h - f, squares[1], b + d, c + g),
        (c - g, b + d, squares[2], f + h),
        (d - b, c + g, f + h, squares[3]),
    )[largest]
    return (w, x, y, z) if w >= 0.0 else (-w, -x, -y, -z)


def _transposed(turn: Matrix) -> Matrix:
    first, second, third = zip(*turn, strict=True)
    return first, second, third
