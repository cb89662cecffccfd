"""Orientations as a controller writes them: O, A, T in two conventions, and increments as ``TRANS(...)`` text. Pure.

    zyz          R = Rz(O) Ry(A) Rz(T); no turn is (0, 0, 0). V+, and what the thesis's numbers speak for.
    val_offset   R = Rz(O) M Ry(A) Rz(T), M = [0 1 0; 0 0 -1; -1 0 0]; the same as zyz with O - 90 and A + 90, so
                 no turn is (90, -90, 0). VAL of 1977.

Which one a controller's TRANS takes is not public. In the wrong one a pure shift becomes a turn of 120 degrees, so it
is settled by a probe that moves nothing (``settled_by``), or by the operator.

A small turn has a small A, but O and T are large and nearly cancel: rounded one by one they would leave a turn about
Z that nobody asked for. ``trans_text`` rounds O, and then T so that O + T is right. What is left of a turn's error is
half a unit of the last decimal in A, half a unit about Z, and A times half a unit in the direction of the axis:
together below one unit of the last decimal [deg] for turns of up to 20 degrees. Turns about one tool axis have O and T
of whole right angles and come out exact.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from services.wire.actions import Increment

Convention = Literal["zyz", "val_offset"]
CONVENTIONS: tuple[Convention, ...] = ("zyz", "val_offset")
Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]
GRID = 4
"""Decimals [mm, deg] that an increment is told back with; what is written has more, so that it is met exactly."""
_OFFSETS: dict[Convention, Vector] = {"zyz": (0.0, 0.0, 0.0), "val_offset": (90.0, -90.0, 0.0)}
_POLE = 1e-9
"""Sine of A below which only O + T means anything."""


class Location(NamedTuple):
    """Where a tool is, as a controller lists it: mm and degrees."""

    x: float
    y: float
    z: float
    o: float
    a: float
    t: float


class Pose(NamedTuple):
    """Position [mm] and orientation, row by row."""

    position: Vector
    turn: Matrix


def matrix_of(o: float, a: float, t: float, convention: Convention) -> Matrix:
    """Return the orientation of O, A, T [deg]."""
    offset_o, offset_a, _ = _OFFSETS[convention]
    return product(product(about_z(o - offset_o), about_y(a - offset_a)), about_z(t))


def angles_of(turn: Matrix, convention: Convention) -> Vector:
    """Return O, A, T [deg] of an orientation; with the tool's axis upright, where only O + T counts, O is that of 0."""
    offset_o, offset_a, _ = _OFFSETS[convention]
    (_, _, r13), (r21, r22, r23), (r31, r32, r33) = turn
    sine = math.hypot(r13, r23)
    if sine < _POLE and r33 > 0.0:
        return offset_o, offset_a, math.degrees(math.atan2(r21, r22))
    a = math.degrees(math.atan2(sine, r33))
    if sine < _POLE:
        return offset_o, 180.0 + offset_a, math.degrees(math.atan2(r21, r22))
    o, t = math.degrees(math.atan2(r23, r13)), math.degrees(math.atan2(r32, -r31))
    return o + offset_o, a + offset_a, t


def turn_of(increment: Increment) -> Matrix:
    """Return an increment's rotation, R = Rz(rz) Ry(ry) Rx(rx)."""
    return product(product(about_z(increment.rz_deg), about_y(increment.ry_deg)), about_x(increment.rx_deg))


def tilt_of(turn: Matrix) -> Vector:
    """Return rx, ry, rz [deg] of a rotation, ry being of -90 to 90."""
    ry = math.degrees(math.asin(max(-1.0, min(1.0, -turn[2][0]))))
    rx, rz = math.atan2(turn[2][1], turn[2][2]), math.atan2(turn[1][0], turn[0][0])
    return math.degrees(rx), ry, math.degrees(rz)


class Written(NamedTuple):
    """An increment in a controller's words."""

    text: str
    """``TRANS(x,y,z,o,a,t)``"""
    applied: Increment
    """What the text says, rounded to GRID decimals."""


def trans_text(increment: Increment, convention: Convention, decimals: int = 5) -> Written:
    """Return the ``TRANS(...)`` of an increment [mm, deg], rounded to so many decimals (2 to 9)."""
    shift = [round(value, decimals) for value in increment[:3]]
    offset_o, offset_a, _ = _OFFSETS[convention]
    # Worked out as zyz and offset at the end, so that both conventions round alike.
    o, a, t = angles_of(turn_of(increment), "zyz")
    total = round(o + t, decimals)
    o, a = round(o, decimals), round(a, decimals)
    if a == 0.0:
        o = 0.0
    t = _within_a_turn(round(total - o, decimals))
    said = matrix_of(o, a, t, "zyz")
    numbers = (*shift, round(o + offset_o, decimals), round(a + offset_a, decimals), t)
    applied = Increment(*(_on_grid(value, decimals) for value in (*shift, *tilt_of(said))))
    return Written(f"TRANS({','.join(_number(value, decimals) for value in numbers)})", applied)


def pose_of(location: Location, convention: Convention) -> Pose:
    """Return the pose that a controller's numbers mean."""
    return Pose((location.x, location.y, location.z), matrix_of(*location[3:], convention))


def after(pose: Pose, increment: Increment) -> Pose:
    """Return the pose after an increment in its own tool frame."""
    shift = increment[:3]
    x, y, z = (p + sum(r * d for r, d in zip(row, shift, strict=True)) for p, row in zip(*pose, strict=True))
    return Pose((x, y, z), product(pose.turn, turn_of(increment)))


def apart(pose: Pose, other: Pose) -> tuple[float, float]:
    """Return how far two poses are apart: distance [mm] and turn [deg]."""
    rest = product(transpose(pose.turn), other.turn)
    # By sine and cosine: the arc cosine alone cannot tell small turns.
    sine = math.hypot(rest[2][1] - rest[1][2], rest[0][2] - rest[2][0], rest[1][0] - rest[0][1])
    cosine = rest[0][0] + rest[1][1] + rest[2][2] - 1.0
    return math.dist(pose.position, other.position), math.degrees(math.atan2(sine, cosine))


def settled_by(here: Location, probe: Location, tolerance_deg: float = 0.1) -> Convention | None:
    """Return the convention of a controller that made ``probe`` of ``here:TRANS(0,0,0,0,0,0)``; None if unclear.

    Each convention says what such a location must be listed as; exactly one has to fit.
    """
    if math.dist(here[:3], probe[:3]) > tolerance_deg:
        return None
    fits = []
    for convention in CONVENTIONS:
        expected = product(matrix_of(*here[3:], convention), matrix_of(0.0, 0.0, 0.0, convention))
        still = Pose((0.0, 0.0, 0.0), expected)
        listed = Pose((0.0, 0.0, 0.0), matrix_of(*probe[3:], convention))
        if apart(still, listed)[1] <= tolerance_deg:
            fits.append(convention)
    return fits[0] if len(fits) == 1 else None


def product(left: Matrix, right: Matrix) -> Matrix:
    """Return the rotation ``right`` first, then ``left``."""
    p, q, r = right
    first, second, third = (
        (a * p[0] + b * q[0] + c * r[0], a * p[1] + b * q[1] + c * r[1], a * p[2] + b * q[2] + c * r[2])
        for a, b, c in left
    )
    return first, second, third


def transpose(turn: Matrix) -> Matrix:
    """Return the inverse rotation."""
    (a, b, c), (d, e, f), (g, h, i) = turn
    return (a, d, g), (b, e, h), (c, f, i)


def about_x(deg: float) -> Matrix:
    """Return the right-handed turn about X."""
    c, s = _cos_sin(deg)
    return (1.0, 0.0, 0.0), (0.0, c, -s), (0.0, s, c)


def about_y(deg: float) -> Matrix:
    """Return the right-handed turn about Y."""
    c, s = _cos_sin(deg)
    return (c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c)


def about_z(deg: float) -> Matrix:
    """Return the right-handed turn about Z."""
    c, s = _cos_sin(deg)
    return (c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)


def _cos_sin(deg: float) -> tuple[float, float]:
    """Return cosine and sine, exact for right angles."""
    quarters, rest = divmod(deg, 90.0)
    if rest == 0.0:
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarters) % 4]
    return math.cos(math.radians(deg)), math.sin(math.radians(deg))


def _within_a_turn(deg: float) -> float:
    return deg - 360.0 * math.floor((deg + 180.0) / 360.0)


def _on_grid(value: float, decimals: int) -> float:
    return round(value, min(GRID, decimals)) + 0.0  # no negative zero


def _number(value: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text
