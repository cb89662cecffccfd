"""How the sensor sits in the wrist: from its own frame to the tool frame of the contract. Pure.

The contract's torques refer to the sensor's point, so a rotation is all that most mountings need. ``x y z`` [mm] is
where that point lies from the origin of the sensor's calibration, in the sensor's frame; ``rx ry rz`` [deg] turn the
tool frame into the sensor's, about its own axes in this order; ``negate`` for a sensor that reports what it does to the
peg instead of what the peg does to it. With all of them zero, numbers pass bit by bit.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

from services.rules.settings import SettingError
from services.wire.messages import Force, Torque
from services.wire.text import numbers

Matrix = tuple[Force, Force, Force]


@dataclass(frozen=True)
class Mount:
    """The sensor's mounting."""

    x_mm: float = 0.0
    y_mm: float = 0.0
    z_mm: float = 0.0
    rx_deg: float = 0.0
    ry_deg: float = 0.0
    rz_deg: float = 0.0
    negate: bool = False

    @property
    def is_identity(self) -> bool:
        """Whether it changes nothing."""
        return self == Mount()

    def to_tool(self, force_n: Force, torque_nm: Torque) -> tuple[Force, Torque]:
        """Return a load [N, N m] of the sensor's frame in the tool frame."""
        if self.is_identity:
            return force_n, torque_nm
        fx, fy, fz = force_n
        # Torque about another point: M' = M - r x F.
        x, y, z = self.x_mm * 1e-3, self.y_mm * 1e-3, self.z_mm * 1e-3
        mx, my, mz = torque_nm
        moved = (mx - (y * fz - z * fy), my - (z * fx - x * fz), mz - (x * fy - y * fx))
        turn = _product(_product(_about(0, self.rx_deg), _about(1, self.ry_deg)), _about(2, self.rz_deg))
        return self._signed(_apply(turn, force_n)), self._signed(_apply(turn, moved))

    def _signed(self, vector: Force) -> Force:
        return (-vector[0], -vector[1], -vector[2]) if self.negate else vector


def add_arguments(made: argparse.ArgumentParser, where: str = "the sensor in the wrist", who: str = "sensor") -> None:
    """Add the options that ``parse`` reads; ``where`` and ``who`` name, in their help, the frame and who reports."""
    made.add_argument("--mount", default="0,0,0,0,0,0", help=f"x,y,z,rx,ry,rz of {where} [mm, deg]")
    made.add_argument("--negate", action="store_true", help=f"the {who} reports what it does to the peg")


def parse(text: str, negate: bool) -> Mount:
    """Return the mounting in six numbers with commas between, ``x,y,z,rx,ry,rz`` [mm, deg]. Raises SettingError."""
    try:
        x, y, z, rx, ry, rz = numbers(text, 6)
    except ValueError as error:
        raise SettingError(f"mount: expected x,y,z,rx,ry,rz [mm, deg]; {error}") from None
    if max(abs(x), abs(y), abs(z)) > 1000.0 or max(abs(rx), abs(ry), abs(rz)) > 360.0:
        raise SettingError(f"mount: expected x,y,z,rx,ry,rz of at most 1000 mm and 360 deg, got {text[:80]!r}")
    return Mount(x, y, z, rx, ry, rz, negate)


def _about(axis: int, degrees: float) -> Matrix:
    """Return the rotation about an axis; quarter turns are exact."""
    quarters = degrees / 90.0
    if quarters.is_integer():
        cosine, sine = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarters) % 4]
    else:
        cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    if axis == 0:
        return (1.0, 0.0, 0.0), (0.0, cosine, -sine), (0.0, sine, cosine)
    if axis == 1:
        return (cosine, 0.0, sine), (0.0, 1.0, 0.0), (-sine, 0.0, cosine)
    return (cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0)


def _product(a: Matrix, b: Matrix) -> Matrix:
    columns = list(zip(*b, strict=True))
    rows = [tuple(sum(p * q for p, q in zip(row, column, strict=True)) for column in columns) for row in a]
    return _matrix(rows)


def _matrix(rows: list[tuple[float, ...]]) -> Matrix:
    (a, b, c), (d, e, f), (g, h, i) = rows
    return (a, b, c), (d, e, f), (g, h, i)


def _apply(matrix: Matrix, vector: Force) -> Force:
    x, y, z = (sum(p * q for p, q in zip(row, vector, strict=True)) for row in matrix)
    return x, y, z
