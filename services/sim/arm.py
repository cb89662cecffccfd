"""The arm's positioning error: what a commanded motion really becomes (docs/decisions/0006).

The thesis measured single motions of 0.2 mm with dial gauges (Tables 5.1 to 5.3). Each motion starts from where the
arm is, so its error is one draw of its own and the errors of an episode add up. Whoever commanded it does not learn it.
"""

from __future__ import annotations

from services.wire.actions import Increment
from services.wire.definition import Noise
from services.wire.randomness import Draws, Role


class Arm:
    """Errors of one run's motions; each is a function of seed, episode and step and of nothing else."""

    def __init__(self, noise: Noise, seed: int) -> None:
        self._along_mm = noise.scale * noise.along_mm
        self._across_mm = noise.scale * noise.across_mm
        self._turn_deg = noise.scale * noise.turn_deg
        self._draws = Draws(seed, Role.ARM_ERROR)
        self._exact = self._along_mm == self._across_mm == self._turn_deg == 0.0

    def executed(self, commanded: Increment, episode: int, step: int) -> Increment:
        """Return the increment [mm, deg] that the arm really makes, in the tool frame."""
        if self._exact:
            return commanded
        x, y, z, rx, ry, rz = commanded
        along_mm, across_mm, turn_deg = self._along_mm, self._across_mm, self._turn_deg
        ex, ey, ez, erx, ery, erz = self._draws.at(episode, step).standard_normal(6).tolist()
        return Increment(
            x + (along_mm if x else across_mm) * ex,
            y + (along_mm if y else across_mm) * ey,
            z + (along_mm if z else across_mm) * ez,
            rx + turn_deg * erx,
            ry + turn_deg * ery,
            rz + turn_deg * erz,
        )
