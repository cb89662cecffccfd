"""The geometry of emulated controllers: 4 x 4 matrices, millimetres. Shares nothing with the drivers'.

``increment_of`` gives back the very numbers that a motion was asked for with: a goal comes as six float64, of which the
step from the goal before is worked out to some 1e-12 mm, and rounded to GRID decimals.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from services.wire.actions import Increment

Frame: TypeAlias = npt.NDArray[np.float64]
"""Shape (4, 4)."""
GRID = 4
"""Decimals [mm, deg] of an increment."""


def frame(pose: Sequence[float]) -> Frame:
    """Return the frame of X, Y, Z [m] and a rotation vector [rad] (Rodrigues)."""
    made = np.eye(4)
    made[:3, 3] = 1000.0 * np.asarray(pose[:3])
    vector = np.asarray(pose[3:], dtype=np.float64)
    angle = float(np.linalg.norm(vector))
    if angle > 0.0:
        x, y, z = vector / angle
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        made[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    return made


def increment_of(start: Frame, end: Frame) -> Increment:
    """Return the step between two places in the tool frame, R = Rz(rz) Ry(ry) Rx(rx), on the grid."""
    step = np.eye(4)
    step[:3, :3] = start[:3, :3].T @ end[:3, :3]
    step[:3, 3] = start[:3, :3].T @ (end[:3, 3] - start[:3, 3])
    (r11, _, _), (r21, _, _), (r31, r32, r33) = step[:3, :3].tolist()
    rx, rz = np.arctan2(r32, r33), np.arctan2(r21, r11)
    ry = np.arctan2(-r31, np.hypot(r11, r21))
    values = (*step[:3, 3].tolist(), *np.degrees([rx, ry, rz]).tolist())
    return Increment(*(round(value, GRID) + 0.0 for value in values))


def apart(start: Frame, end: Frame) -> tuple[float, float]:
    """Return how far two places are apart [mm] and turned [deg]."""
    turn = start[:3, :3].T @ end[:3, :3]
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    angle = np.arctan2(float(np.linalg.norm(axis)), float(np.trace(turn)) - 1.0)
    return float(np.linalg.norm(end[:3, 3] - start[:3, 3])), float(np.degrees(angle))


def between(start: Sequence[float], end: Sequence[float], fraction: float) -> tuple[float, ...]:
    """Return a pose on the way: the position on a line, the orientation of the start."""
    way = (a + fraction * (b - a) for a, b in zip(start[:3], end[:3], strict=True))
    return (*way, *start[3:])


def turned(place: Frame, load: Sequence[float]) -> tuple[float, ...]:
    """Return a load of the tool frame along the axes of the base."""
    rotation = place[:3, :3]
    return (*(rotation @ np.asarray(load[:3])).tolist(), *(rotation @ np.asarray(load[3:])).tolist())
