"""The emulated controller's own geometry: 4 x 4 matrices, millimetres, degrees. Shares nothing with the driver's.

``increment_of`` gives back the very numbers that a motion was asked for with: what comes over the line is rounded to
GRID decimals, which a driver that writes at least one decimal more meets to the bit.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Frame: TypeAlias = npt.NDArray[np.float64]
"""Shape (4, 4): columns n, s, a, p."""
GRID = 4
"""Decimals [mm, deg] of an increment."""
CONVENTIONS = ("zyz", "val_offset")
_HAND = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
"""The hand with O = A = T = 0 in Unimation's convention."""


def frame(numbers: tuple[float, ...], convention: str) -> Frame:
    """Return the frame of X, Y, Z, O, A, T."""
    x, y, z, o, a, t = numbers
    pose = np.eye(4)
    middle = _HAND if convention == "val_offset" else np.eye(3)
    pose[:3, :3] = _turn(2, o) @ middle @ _turn(1, a) @ _turn(2, t)
    pose[:3, 3] = x, y, z
    return pose


def numbers_of(place: Frame, convention: str) -> tuple[float, ...]:
    """Return X, Y, Z, O, A, T of a frame (Fu, Gonzalez and Lee's inverse for VAL's own convention)."""
    (r11, r12, r13), (r21, r22, r23), (r31, r32, r33) = place[:3, :3].tolist()
    upright = np.hypot(r13, r23) < 1e-9
    if convention == "val_offset":
        if upright:
            o, a, t = np.pi / 2, np.arctan2(-r33, 0.0), np.arctan2(r21, r22)
        else:
            t = np.arctan2(r32, -r31)
            s, c = np.sin(t), np.cos(t)
            a = np.arctan2(-r33, -r31 * c + r32 * s)
            o = np.arctan2(r21 * s + r22 * c, r11 * s + r12 * c)
    elif upright:
        o, a, t = 0.0, (0.0 if r33 > 0 else np.pi), np.arctan2(r21, r22)
    else:
        o, a, t = np.arctan2(r23, r13), np.arctan2(np.hypot(r13, r23), r33), np.arctan2(r32, -r31)
    turned = (float(np.degrees(value)) for value in (o, a, t))
    return (*(float(value) for value in place[:3, 3]), *turned)


def increment_of(step: Frame) -> tuple[float, ...]:
    """Return dx, dy, dz [mm], rx, ry, rz [deg] of a step in the tool frame, R = Rz(rz) Ry(ry) Rx(rx), on the grid."""
    (r11, _, _), (r21, _, _), (r31, r32, r33) = step[:3, :3].tolist()
    rx, rz = np.arctan2(r32, r33), np.arctan2(r21, r11)
    ry = np.arctan2(-r31, np.hypot(r11, r21))
    values = (*step[:3, 3].tolist(), *np.degrees([rx, ry, rz]).tolist())
    return tuple(round(value, GRID) + 0.0 for value in values)


def between(start: Frame, end: Frame, fraction: float) -> Frame:
    """Return a place on the way: the position on a line, the orientation of the start."""
    pose = start.copy()
    pose[:3, 3] += fraction * (end[:3, 3] - start[:3, 3])
    return pose


def _turn(axis: int, deg: float) -> Frame:
    angle = np.radians(deg)
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[i, i], rotation[i, j], rotation[j, i], rotation[j, j] = c, -s, s, c
    return rotation
