"""Moves within bounds: what a learner that proposes increments may propose, and what that counts as. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

from services.wire.actions import GRID, Increment, increments
from services.wire.definition import Definition
from services.wire.force_bound import ForceBound

_ROUNDING = 1e-9
_UNIT = 10.0**-GRID


class Bounds:
    """``moves.continuous`` of a definition, and the most force that one of its listed moves adds."""

    def __init__(self, definition: Definition) -> None:
        most = definition.moves.continuous
        turns = (most.rx_deg, most.ry_deg, most.rz_deg)
        self.low = Increment(-most.x_mm, -most.y_mm, -most.back_mm, *(-turn for turn in turns))
        """The least of each axis [mm, deg]."""
        self.high = Increment(most.x_mm, most.y_mm, most.z_mm, *turns)
        """The greatest of each axis."""
        pairs = zip(self.low, self.high, strict=True)
        self.axes = tuple(axis for axis, (low, high) in enumerate(pairs) if low < high)
        """Components that may be other than 0, by their place in an increment; none where there are no bounds."""
        self._force = ForceBound(definition)
        depths = [increment.dz_mm for increment in increments(definition.moves)]
        self._aside = next((number for number, depth in enumerate(depths) if depth == 0.0), 0)
        self._deeper = next((number for number, depth in enumerate(depths) if depth > 0.0), self._aside)
        self._back = next((number for number, depth in enumerate(depths) if depth < 0.0), self._aside)

    def counts_as(self, increment: Increment) -> int:
        """Return the move of the list that an increment counts as, for the reward and for the no-progress rule.

        With half of the greatest step of +Z or more it counts as one of insertion, with any of -Z as one back out, else
        as one that stays at its depth: of the list the first of that kind.
        """
        if increment.dz_mm < 0.0:
            return self._back
        return self._deeper if increment.dz_mm >= self.high.dz_mm / 2.0 > 0.0 else self._aside

    def within(self, parts: Sequence[float]) -> Increment:
        """Return the increment of parts of the way, one for each of ``axes``: -1 is the least, 1 the greatest.

        Along Z, where there is no way back, -1 stays. What would add more force than the most forceful move of the list
        is made shorter, all components alike, and all are rounded towards 0 to ``GRID`` decimals. Raises ValueError for
        parts that are not that many, or beyond -1 and 1.
        """
        if len(parts) != len(self.axes) or not all(-1.0 <= part <= 1.0 for part in parts):
            raise ValueError(f"parts of a move: expected {len(self.axes)} from -1 to 1, got {list(parts)}")
        values = [0.0] * len(self.low)
        for axis, part in zip(self.axes, parts, strict=True):
            values[axis] = self.low[axis] + (part + 1.0) / 2.0 * (self.high[axis] - self.low[axis])
        return on_grid(self._shorter(Increment(*values)))

    def parts_of(self, increment: Increment) -> tuple[float, ...]:
        """Return which parts of the way an increment goes, one for each of ``axes``, from -1 to 1."""
        return tuple(
            2.0 * (increment[axis] - self.low[axis]) / (self.high[axis] - self.low[axis]) - 1.0 for axis in self.axes
        )

    def hold(self, increment: Increment) -> bool:
        """Return whether each component is within its bounds; never where there are none."""
        return bool(self.axes) and all(
            low - _ROUNDING <= value <= high + _ROUNDING
            for low, value, high in zip(self.low, increment, self.high, strict=True)
        )

    def complaint(self, increment: Increment) -> str | None:
        """Return why an increment is none that may be proposed, or None."""
        if not self.axes:
            return "expected the number of a move, as moves.continuous has no bounds, got an increment"
        for name, low, value, high in zip(Increment._fields, self.low, increment, self.high, strict=True):
            if not low - _ROUNDING <= value <= high + _ROUNDING:  # what is no number never passes
                return f"{name}: expected {low:g} to {high:g}, as moves.continuous says, got {value}"
        added_n, most_n = self._force.added_n(increment), self._force.largest_n
        if added_n > most_n + _ROUNDING:
            return f"size: expected at most the {most_n:.2f} N that a listed move can add, got {added_n:.2f} N"
        return None

    def _shorter(self, increment: Increment) -> Increment:
        """Return an increment that adds no more force than the most forceful move of the list."""
        unmoved_n = self._force.added_n(Increment())
        added_n, most_n = self._force.added_n(increment) - unmoved_n, self._force.largest_n - unmoved_n
        return Increment(*(value * (most_n / added_n) for value in increment)) if added_n > most_n else increment


def on_grid(increment: Increment) -> Increment:
    """Return an increment rounded to ``GRID`` decimals, towards 0 so that it stays within bounds."""
    return Increment(*map(_towards_zero, increment))


def _towards_zero(value: float) -> float:
    if not math.isfinite(value):
        return value
    rounded = round(value, GRID)
    if abs(rounded) > abs(value):
        rounded = round(rounded - math.copysign(_UNIT, value), GRID)
    return rounded + 0.0  # no negative zero
