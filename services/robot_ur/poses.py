"""Poses as a UR controller has them: X, Y, Z [m] and a rotation vector [rad] in its base frame. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from services.rules.poses import Pose, from_rotation_vector, rotation_vector


def to_ur(pose: Pose) -> list[float]:
    """Return the controller's six numbers."""
    return [*(value / 1000.0 for value in pose.position_mm), *rotation_vector(pose.turn)]


def from_ur(numbers: Sequence[float]) -> Pose:
    """Return the pose of the controller's six numbers."""
    x, y, z, rx, ry, rz = numbers
    return Pose((1000.0 * x, 1000.0 * y, 1000.0 * z), from_rotation_vector((rx, ry, rz)))
