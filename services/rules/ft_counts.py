"""Counts of a force/torque receiver: what a load becomes in 16-bit words, and what those words read as. Pure.

A receiver gives each component as a signed 16-bit number; 16384 is its full scale, and there is room for twice that.
Full scales are whole numbers in the receiver's own unit. What leaves here is SI: N and N m, in the sensor's own frame.

Both directions are exact, so that independent code gives the same bits: a load becomes the nearest count, of two that
are equally near the even one, worked out without rounding on the way; a count becomes the float64 nearest to its exact
value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple

from services.wire.errors import TreenailError
from services.wire.messages import Force, Torque

FULL_SCALE_COUNTS = 16384
MOST_COUNTS, LEAST_COUNTS = 32767, -32768
AXES = ("fx", "fy", "fz", "mx", "my", "mz")

_POUND_N = Fraction("4.4482216152605")
_INCH_M = Fraction("0.0254")
_KILOPOND_N = Fraction("9.80665")


class CountsError(TreenailError):
    """Full scales, units or ADC bits that no receiver has."""


class Unit(NamedTuple):
    """What one unit of a full-scale word is worth."""

    force_n: Fraction
    torque_nm: Fraction
    length_mm: Fraction
    """Of one unit of a translation in a transform."""
    words: str
    confidence: str
    """S sure, L likely, U unknown."""


UNITS: dict[str, Unit] = {
    "0": Unit(_POUND_N, _POUND_N * _INCH_M, Fraction("0.0254"), "lb, in lb, inch x 1000", "S"),
    "1": Unit(Fraction(1), Fraction(1, 10), Fraction("0.1"), "N, N m x 10, mm x 10", "S"),
    # Public drivers disagree whether code 2 is kgf x 10 or kgf; the tenths are those of Nitta's receivers.
    "2": Unit(_KILOPOND_N / 10, _KILOPOND_N / 100, Fraction("0.1"), "kgf x 10, kgf cm, mm x 10", "L"),
    "2-kgf": Unit(_KILOPOND_N, _KILOPOND_N / 100, Fraction("0.1"), "kgf, kgf cm, mm x 10", "L"),
    "3": Unit(_POUND_N * 1000, _POUND_N * _INCH_M * 1000, Fraction("0.0254"), "klb, k in lb, inch x 1000", "L"),
}
"""By the code in the receiver's word FC, with ``2-kgf`` for the other reading of code 2."""


class Counted(NamedTuple):
    """A load as a receiver shows it."""

    counts: tuple[int, ...]
    """Fx Fy Fz Mx My Mz."""
    saturated: bool
    """True when a component is at or above saturation; its count is then the largest there is, not the load's."""


@dataclass(frozen=True)
class FtCounts:
    """The scale of one receiver: unit and full scales."""

    units: str
    """A key of UNITS."""
    full_scales: tuple[int, ...]
    """Fx Fy Fz Mx My Mz, in the unit, 1 to 32767 each."""
    adc_bits: int = 14
    """Bits of the sensor's converter, 8 to 16: saturation is at 32768 - 2**(16 - bits) counts."""

    def __post_init__(self) -> None:
        """Raise CountsError for what no receiver has."""
        if self.units not in UNITS:
            raise CountsError(f"units: expected one of {', '.join(UNITS)}, got {self.units[:20]!r}")
        scales = self.full_scales
        if len(scales) != len(AXES) or not all(1 <= scale <= MOST_COUNTS for scale in scales):
            raise CountsError(f"full scales: expected six from 1 to {MOST_COUNTS}, got {list(scales)}")
        if not 8 <= self.adc_bits <= 16:
            raise CountsError(f"ADC bits: expected 8 to 16, got {self.adc_bits}")

    @property
    def saturation_counts(self) -> int:
        """Magnitude at which a component is saturated."""
        return min(MOST_COUNTS, 32768 - (1 << (16 - self.adc_bits)))

    def read(self, counts: Sequence[int]) -> tuple[Force, Torque]:
        """Return force [N] and torque [N m] that six counts stand for."""
        # Division of whole numbers gives the nearest float64, whatever their size.
        fx, fy, fz, mx, my, mz = (count * up / down for count, (up, down) in zip(counts, self._ratios, strict=True))
        return (fx, fy, fz), (mx, my, mz)

    def count(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> Counted:
        """Return the counts of a load: finite force [N] and torque [N m]."""
        nearest = [_nearest(value, pair) for value, pair in zip((*force_n, *torque_nm), self._ratios, strict=True)]
        saturated = any(abs(count) >= self.saturation_counts for count in nearest)
        return Counted(tuple(max(LEAST_COUNTS, min(MOST_COUNTS, count)) for count in nearest), saturated)

    def quantised(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> tuple[Force, Torque, bool]:
        """Return the load [N, N m] that a receiver would show for this one, and whether it would be saturated."""
        counted = self.count(force_n, torque_nm)
        return *self.read(counted.counts), counted.saturated

    @cached_property
    def _ratios(self) -> tuple[tuple[int, int], ...]:
        """What one count of each component is worth [N, N m], as numerator and denominator."""
        unit = UNITS[self.units]
        units = (unit.force_n,) * 3 + (unit.torque_nm,) * 3
        loads = (scale * worth for scale, worth in zip(self.full_scales, units, strict=True))
        return tuple((load / FULL_SCALE_COUNTS).as_integer_ratio() for load in loads)


def _nearest(value: float, ratio: tuple[int, int]) -> int:
    """Return the whole number nearest to ``value / (up / down)``, the even one of two."""
    up, down = ratio
    numerator, denominator = value.as_integer_ratio()
    quotient, rest = divmod(numerator * down, denominator * up)
    twice = 2 * rest
    over = twice > denominator * up or (twice == denominator * up and quotient % 2 == 1)
    return quotient + over
