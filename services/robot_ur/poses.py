"""Where the tool is in the robot's base frame, and the increments that move it. Pure; millimetres and degrees.

The controller has metres and a rotation vector [rad]. Each goal follows from the goal before, never from where the arm
was measured to be: its last micrometres do not add up, and the same increments give the same goals, bit by bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from services.rules.workspace import Matrix, Vector, product, rotation, turned
from services.wire.actions import Increment

_SMALL = 1e-12


class Pose(NamedTuple):
    """A place of the tool."""

    position_mm: Vector
    turn: Matrix
    """Tool axes in the base frame, row by row."""

    def after(self, increment: Increment) -> Pose:
        """Return the pose after one increment in this pose's own tool frame."""
        shift = turned(self.turn, increment[:3])
        x, y, z = (a + b for a, b in zip(self.position_mm, shift, strict=True))
        if increment[3:] == (0.0, 0.0, 0.0):
            return Pose((x, y, z), self.turn)
        return Pose((x, y, z), product(self.turn, rotation(*increment[3:])))

    def to_ur(self) -> list[float]:
        """Return X, Y, Z [m] and a rotation vector [rad]."""
        return [*(value / 1000.0 for value in self.position_mm), *rotation_vector(self.turn)]

    def in_tool(self, vector: Sequence[float]) -> Vector:
        """Return a vector of the base frame along the tool's axes."""
        a, b, c = vector
        x, y, z = (column[0] * a + column[1] * b + column[2] * c for column in zip(*self.turn, strict=True))
        return x, y, z


def from_ur(numbers: Sequence[float]) -> Pose:
    """Return the pose of X, Y, Z [m] and a rotation vector [rad]."""
    x, y, z, rx, ry, rz = numbers
    return Pose((1000.0 * x, 1000.0 * y, 1000.0 * z), from_rotation_vector((rx, ry, rz)))


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
    """Return axis times angle [rad], the shorter way round; by the largest part of the quaternion, so also near pi."""
    (a, b, c), (d, e, f), (g, h, i) = turn
    squares = (1.0 + a + e + i, 1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i)
    largest = max(range(4), key=squares.__getitem__)
    w, x, y, z = (
        (squares[0], h - f, c - g, d - b),
        (h - f, squares[1], b + d, c + g),
        (c - g, b + d, squares[2], f + h),
        (d - b, c + g, f + h, squares[3]),
    )[largest]
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.hypot(x, y, z)
    factor = 0.0 if sine == 0.0 else 2.0 * math.atan2(sine, w) / sine
    return factor * x, factor * y, factor * z


def _transposed(turn: Matrix) -> Matrix:
    first, second, third = zip(*turn, strict=True)
    return first, second, third
