"""How far one episode may take the arm: what is commanded since ``home``, added up as a robot knows it. Pure.

Distance and turn are those of the composed motion, not sums of components: a sequence of small turns and shifts that
cancel out component by component still leads away.
"""

from __future__ import annotations

import math

from services.wire.actions import Increment, extremes
from services.wire.definition import Definition
from services.wire.definition_rules import reach_mm

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

UPRIGHT: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_ROUNDING = 1e-6
"""Tolerance [mm, deg] for what adding up thousands of motions in another order gives."""


class Workspace:
    """Depth, distance from the start and turn since the start, each with its limit."""

    def __init__(self, definition: Definition) -> None:
        """Take the limits from a definition; where it gives none, what its longest episode can do."""
        moves, limits = definition.moves, definition.limits
        motions = extremes(moves)
        shift_mm = max(math.hypot(*motion[:3]) for motion in motions)
        turn_deg = moves.rotation_deg
        if moves.list or moves.continuous.any:
            turn_deg = max(sum(map(abs, motion[3:])) for motion in motions)
        self._centre_mm = moves.rotation_centre_mm
        # A tip that swings about a point behind it is at most twice as far away as that point.
        self._most_mm = limits.workspace_mm or limits.move_limit * shift_mm + 2.0 * self._centre_mm
        self._most_deg = limits.workspace_deg or min(180.0, limits.move_limit * turn_deg)
        self._deepest_mm = limits.deepest_mm or reach_mm(definition)
        self.begin(0.0)

    def begin(self, z_mm: float) -> None:
        """Begin at a start pose whose tip is ``z_mm`` below the mouth."""
        self._depth_mm = z_mm
        self._position: Vector = (0.0, 0.0, 0.0)
        """Tip in the tool frame of the start [mm]."""
        self._turn = UPRIGHT
        """Orientation in that frame, row by row."""
        self._asked: tuple[Increment, Vector, Matrix] | None = None
        """A motion that was asked for since the last one, and where it leads."""

    def complaint(self, increment: Increment) -> str | None:
        """Return which limit a motion would lead beyond, or None."""
        depth_mm = self._depth_mm + increment.dz_mm
        if depth_mm > self._deepest_mm + _ROUNDING:
            return f"guard: depth: expected at most {self._deepest_mm:.3f} mm commanded, got {depth_mm:.3f}"
        position, turn = self._after(increment)
        self._asked = (increment, position, turn)
        away_mm = math.hypot(*position)
        if away_mm > self._most_mm + _ROUNDING:
            return f"guard: workspace: expected at most {self._most_mm:g} mm from the start, got {away_mm:.3f}"
        cosine = (turn[0][0] + turn[1][1] + turn[2][2] - 1.0) / 2.0
        turned_deg = math.degrees(math.acos(min(1.0, max(-1.0, cosine))))
        if turned_deg > self._most_deg + _ROUNDING:
            return f"guard: workspace: expected at most {self._most_deg:g} deg turned, got {turned_deg:.3f}"
        return None

    def take(self, increment: Increment) -> None:
        """Add a motion that was made."""
        self._depth_mm += increment.dz_mm
        asked, self._asked = self._asked, None
        if asked is None or asked[0] != increment:
            self._position, self._turn = self._after(increment)
        else:  # as a rule: where it leads has been reckoned already
            _, self._position, self._turn = asked

    def _after(self, increment: Increment) -> tuple[Vector, Matrix]:
        a, b, c = turned(self._turn, increment[:3])
        x, y, z = self._position
        position = (x + a, y + b, z + c)
        if increment[3:] == (0.0, 0.0, 0.0):
            return position, self._turn
        turn = product(self._turn, rotation(*increment[3:]))
        if self._centre_mm:
            # The tip swings about a point behind it: it is the axis, the last column, that says by how much.
            swung = (self._centre_mm * (new[2] - old[2]) for new, old in zip(turn, self._turn, strict=True))
            x, y, z = (at + by for at, by in zip(position, swung, strict=True))
            position = (x, y, z)
        return position, turn


def turned(turn: Matrix, vector: Vector) -> Vector:
    """Return a vector of the turned frame in the frame that it was turned in."""
    dx, dy, dz = vector
    # Written out here and below, as this is done for every motion.
    (a, b, c), (d, e, f), (g, h, i) = turn
    return a * dx + b * dy + c * dz, d * dx + e * dy + f * dz, g * dx + h * dy + i * dz


def product(left: Matrix, right: Matrix) -> Matrix:
    """Return the turn ``right`` in the frame of the turn ``left``."""
    (a, b, c), (d, e, f), (g, h, i) = left
    (p0, p1, p2), (q0, q1, q2), (r0, r1, r2) = right
    return (
        (a * p0 + b * q0 + c * r0, a * p1 + b * q1 + c * r1, a * p2 + b * q2 + c * r2),
        (d * p0 + e * q0 + f * r0, d * p1 + e * q1 + f * r1, d * p2 + e * q2 + f * r2),
        (g * p0 + h * q0 + i * r0, g * p1 + h * q1 + i * r1, g * p2 + h * q2 + i * r2),
    )


def rotation(rx_deg: float, ry_deg: float, rz_deg: float) -> Matrix:
    """Return the matrix of R = Rz(rz) Ry(ry) Rx(rx), row by row."""
    (cx, sx), (cy, sy), (cz, sz) = ((math.cos(a), math.sin(a)) for a in map(math.radians, (rx_deg, ry_deg, rz_deg)))
    return (
        (cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx),
        (sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx),
        (-sy, cy * sx, cy * cx),
    )
