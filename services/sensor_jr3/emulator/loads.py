"""From a load [N, N m] to the words of an emulated sensor. Pure, and on purpose nothing of the driver's arithmetic.

All is exact rational arithmetic up to the turns of a transform, so that a count is the nearest whole number and of two
the even one, for any load.
"""

from __future__ import annotations

import csv
import math
from bisect import bisect_right
from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from pathlib import Path

from services.rules.settings import SettingError
from services.wire.text import decode, numbers

Load = tuple[float, float, float, float, float, float]
"""Fx Fy Fz [N], Mx My Mz [N m]."""
NO_LOAD: Load = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

_GRAVITY = Fraction("9.80665")
_POUND_KG = Fraction("0.45359237")
_INCH = Fraction("25.4") / 1000
_LB = _POUND_KG * _GRAVITY
# Newton and newton metre in one unit of a full-scale word, by unit code.
_WORTH = {
    0: (_LB, _LB * _INCH),
    1: (Fraction(1), Fraction(1, 10)),
    2: (_GRAVITY / 10, _GRAVITY / 100),
    3: (1000 * _LB, 1000 * _LB * _INCH),
}
_LENGTH_M = {0: _INCH / 1000, 1: Fraction(1, 10000), 2: Fraction(1, 10000), 3: _INCH / 1000}
COLUMNS = ["t_s", "fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"]


def nearest_counts(load: Load, full_scales: Sequence[int], units: int) -> list[int]:
    """Return the counts of a load, unlimited: 16384 is the full scale."""
    return list(_nearest_counts(tuple(load), tuple(full_scales[:6]), units))


@lru_cache(maxsize=1024)
def _nearest_counts(load: tuple[float, ...], full_scales: tuple[int, ...], units: int) -> tuple[int, ...]:
    """Return the same; a card that plays a motion's samples over and over asks for each many times."""
    force_n, moment_nm = _WORTH[units]
    worth = [scale * (force_n if axis < 3 else moment_nm) for axis, scale in enumerate(full_scales)]
    return tuple(round(Fraction(value) * 16384 / unit) for value, unit in zip(load, worth, strict=True))


def load_of(counts: Sequence[int], full_scales: Sequence[int], units: int) -> Load:
    """Return the load that counts stand for."""
    force_n, moment_nm = _WORTH[units]
    components = [
        float(Fraction(count * scale, 16384) * (force_n if axis < 3 else moment_nm))
        for axis, (count, scale) in enumerate(zip(counts, full_scales, strict=True))
    ]
    return (components[0], components[1], components[2], components[3], components[4], components[5])


def inverse(links: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the links that lead back."""
    return [(kind, -amount) for kind, amount in reversed(links)]


def rescaled(counts: Sequence[int], before: Sequence[int], after: Sequence[int]) -> list[int]:
    """Return counts of one set of full scales as those of another."""
    return [round(Fraction(count * old, new)) for count, old, new in zip(counts, before, after, strict=True)]


def transformed(load: Load, links: Sequence[tuple[int, int]], units: int) -> Load:
    """Return a load in axes that links, as (type, signed amount), have moved, turned and negated one after another."""
    for kind, amount in links:
        axis = (kind - 1) % 3
        if kind <= 3:
            load = _move(load, axis, float(amount * _LENGTH_M[units]))
        elif kind <= 6:
            load = _turn(load, axis, amount / 32768 * math.pi)
        else:
            load = tuple(-component for component in load)  # type: ignore[assignment]
    return load


def _move(load: Load, axis: int, distance_m: float) -> Load:
    """Return a load about a point further along an axis."""
    moments = list(load[3:])
    first, second = (axis + 1) % 3, (axis + 2) % 3
    moments[first] += distance_m * load[second]
    moments[second] -= distance_m * load[first]
    return (*load[:3], *moments)  # type: ignore[return-value]


def _turn(load: Load, axis: int, angle: float) -> Load:
    """Return a load in axes that are turned about one of them."""
    components = list(load)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    for start in (0, 3):
        a, b = load[start + first], load[start + second]
        components[start + first] = math.cos(angle) * a + math.sin(angle) * b
        components[start + second] = math.cos(angle) * b - math.sin(angle) * a
    return tuple(components)  # type: ignore[return-value]


class Recording:
    """Loads over time; each holds until the next, the last for ever."""

    def __init__(self, times_s: Sequence[float], loads: Sequence[Load]) -> None:
        self._times_s, self._loads = times_s, loads

    def at(self, t_s: float) -> Load:
        """Return the load at a time since the start [s]."""
        index = bisect_right(self._times_s, t_s) - 1
        return self._loads[index] if index >= 0 else NO_LOAD


def recording(path: Path) -> Recording:
    """Return what a CSV file holds: the columns of COLUMNS, times from 0 on that rise. Raises SettingError."""
    try:
        rows = list(csv.reader(decode(path.read_bytes()).splitlines()))
    except (OSError, ValueError, csv.Error) as error:
        raise SettingError(f"{path}: cannot be read: {error}") from None
    if not rows or rows[0] != COLUMNS:
        raise SettingError(
            f"{path}: line 1: expected {','.join(COLUMNS)}, got {','.join(rows[0] if rows else [])[:80]}"
        )
    times_s: list[float] = []
    loads: list[Load] = []
    for line, row in enumerate(rows[1:], start=2):
        if not row:
            continue  # a blank line, as at the end of what an editor has saved
        try:
            t_s, *load = numbers(",".join(row), len(COLUMNS))
        except ValueError as error:
            raise SettingError(f"{path}: line {line}: {error}") from None
        if t_s < (times_s[-1] if times_s else 0.0):
            raise SettingError(f"{path}: line {line}: expected times that rise from 0, got {row[0]}")
        times_s.append(t_s)
        loads.append((load[0], load[1], load[2], load[3], load[4], load[5]))
    if not loads:
        raise SettingError(f"{path}: expected a load below the columns' names, got none")
    return Recording(times_s, loads)
