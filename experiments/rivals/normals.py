"""Brignone's contact localisation: Fuzzy ART over the normals of the surfaces that form the hole (thesis 2.3).

The network is shown, before anything is touched, the directions in which each surface of the hole can push: faces of
the chamfer, walls of the bore, the flat face around. It knows the shape, its size does not matter. What is felt is
brought to length 1, as the normals are; the class that is nearest says which surface is touched, and the answer is
the motion that this surface allows: aside, away from it; on the flat face, in +Z.

A normal that points between two axes is answered by moves along both in turn. Rotations are not part of it: for these
Brignone had ART-R (``art_r``).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.evaluate.controllers import ACTION, Choice
from services.classifier.fuzzy_art import FuzzyArt
from services.wire.actions import INSERT
from services.wire.cross_section import CrossSection
from services.wire.definition import Definition, Parts
from services.wire.messages import Observation

AROUND = 16
"""Normals around a round hole; of one with corners as many as it has sides."""
RHO, ANY = 0.95, 0.01
"""Vigilance in training, where two neighbouring normals have a class each, and later, where the nearest is taken."""
LEAST = 0.2
"""A part of a normal along an axis below this is no reason to move along it."""
WALL, CHAMFER = 0.0, 1.0
"""How steeply a surface pushes up, as a multiple of how it pushes aside."""


class Surface(NamedTuple):
    """One surface of the hole, or its edge."""

    normal: tuple[float, float, float]
    """Of length 1, into the hole or out of the mouth, in the hole frame."""
    moves: tuple[int, ...]
    """What is done about it, in turn."""


def surfaces(parts: Parts) -> list[Surface]:
    """Return the surfaces that a hole is made of, by its shape and whether it has a chamfer."""
    whole = [Surface((0.0, 0.0, -1.0), (INSERT,))]
    for steepness in (WALL, CHAMFER) if parts.chamfer_mm else (WALL,):
        for x, y in _inwards(parts):
            length = math.hypot(1.0, steepness)
            whole.append(Surface((x / length, y / length, -steepness / length), _aside(x, y)))
    return whole


class NormalsController:
    """Finds the surface that is touched by the direction of the force, and moves away from it."""

    def __init__(self, definition: Definition) -> None:
        """Train the network on the hole's surfaces."""
        trained = FuzzyArt({"rho": RHO, "torque_gain_per_m": 0.0})
        whole = surfaces(definition.parts)
        self._surfaces = [surface for surface in whole if trained.learn(surface.normal, (0.0, 0.0, 0.0)).new]
        self.network = FuzzyArt({"rho": ANY, "torque_gain_per_m": 0.0})
        self.network.restore(trained.snapshot())
        self._decisions = 0

    def begin(self) -> None:
        """Begin an episode."""
        self._decisions = 0

    def decide(self, felt: Observation) -> Choice:
        """Return the next of the moves that the surface which is touched allows; its class is the state."""
        state = self.network.classify(felt.force_n, (0.0, 0.0, 0.0)).state
        moves = self._surfaces[state].moves
        self._decisions += 1
        return Choice(moves[self._decisions % len(moves)], state)


def _inwards(parts: Parts) -> list[tuple[float, float]]:
    """Return the directions, of length 1, in which the sides of the hole push."""
    corners = CrossSection(parts).corners
    if not corners:
        angles = [2.0 * math.pi * number / AROUND for number in range(AROUND)]
        return [(-math.cos(angle), -math.sin(angle)) for angle in angles]
    directions = []
    for (x, y), (next_x, next_y) in zip(corners, (*corners[1:], corners[0]), strict=True):
        normal: NDArray[np.float64] = np.array([y - next_y, next_x - x]) / math.hypot(next_x - x, next_y - y)
        middle = ((x + next_x) / 2.0, (y + next_y) / 2.0)
        sign = -1.0 if normal[0] * middle[0] + normal[1] * middle[1] > 0.0 else 1.0
        directions.append((sign * float(normal[0]), sign * float(normal[1])))
    return directions


def _aside(x: float, y: float) -> tuple[int, ...]:
    """Return the moves that lead along a direction."""
    return tuple(
        ACTION[f"{'+' if part > 0.0 else '-'}{axis}"] for part, axis in ((x, "X"), (y, "Y")) if abs(part) >= LEAST
    )
