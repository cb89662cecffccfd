"""The outline that peg and hole share: the hole's sides are the peg's, each moved out by the same distance. Pure.

All is in the plane across the axis, in mm: the tool frame's X and Y for the peg, the hole frame's for the hole. The
first side of a polygon faces +X; a rectangle's first side length is along X, its second along Y.
"""

from __future__ import annotations

import math

from services.wire.definition import Parts

Corner = tuple[float, float]

_SINE_60 = math.sqrt(3.0) / 2.0


class CrossSection:
    """Outline of one pair of parts: a circle, a square, a rectangle or an equilateral triangle."""

    def __init__(self, parts: Parts) -> None:
        self.is_round = parts.shape == "round"
        self._is_triangle = parts.shape == "triangle"
        self.half_width_mm = (
            parts.peg_width_mm / (2.0 * math.sqrt(3.0)) if self._is_triangle else parts.peg_width_mm / 2
        )
        """How far the peg's sides are from its axis; of a rectangle those that face +X and -X."""
        self.narrower_mm = self.half_width_mm - parts.peg_breadth_mm / 2 if parts.shape == "rectangle" else 0.0
        """How much nearer than these the sides of a rectangle are that face +Y and -Y; below 0 when farther."""
        self.corners = self._corners()
        """Corners of the peg, in the order of their angle from X towards Y; none for a circle."""
        self.radius_mm = max((math.hypot(x, y) for x, y in self.corners), default=self.half_width_mm)
        """How far the farthest point of the peg's outline is from its axis."""

    def aside(self, x_mm: float, y_mm: float) -> float:
        """Return how far a point is from the axis as the sides count it [mm].

        Of the points of the outline moved out by d each is ``half_width_mm + d``; it is the distance from the axis for
        a circle, and along the normal of the side that is nearest from within for a polygon.
        """
        if self.is_round:
            return math.hypot(x_mm, y_mm)
        if self._is_triangle:
            return max(x_mm, _SINE_60 * abs(y_mm) - 0.5 * x_mm)
        return max(abs(x_mm), abs(y_mm) + self.narrower_mm)

    def _corners(self) -> tuple[Corner, ...]:
        half_mm = self.half_width_mm
        if self.is_round:
            return ()
        if self._is_triangle:
            side_mm = half_mm * 2.0 * _SINE_60
            return ((half_mm, side_mm), (-2.0 * half_mm, 0.0), (half_mm, -side_mm))
        across_mm = half_mm - self.narrower_mm
        return ((half_mm, across_mm), (-half_mm, across_mm), (-half_mm, -across_mm), (half_mm, -across_mm))
