"""How the hole really stands in one episode, and poses as it sees them. Pure.

The cell's frame is the hole frame of an upright hole: starts are given in it. A tilted hole has its own, turned about
the centre of the mouth. It is for the simulator and for who looks on; whoever has to insert is not told.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from services.rules.quaternion import Quaternion, multiply
from services.wire.definition_world import Hole
from services.wire.messages import PoseNumbers
from services.wire.randomness import Role, generator


class Standing(NamedTuple):
    """The turn from the hole frame to the cell's frame, a unit quaternion w, x, y, z."""

    turn: Quaternion

    def in_hole(self, pose: PoseNumbers) -> PoseNumbers:
        """Return a pose (x, y, z [mm], quaternion w, x, y, z) of the cell's frame in the hole frame."""
        w, x, y, z = self.turn
        return _turned((w, -x, -y, -z), pose)

    def in_cell(self, pose: PoseNumbers) -> PoseNumbers:
        """Return a pose of the hole frame in the cell's frame."""
        return _turned(self.turn, pose)


UPRIGHT = Standing((1.0, 0.0, 0.0, 0.0))


def tilt_deg(hole: Hole, seed: int, episode: int) -> tuple[float, float]:
    """Return the hole's tilt about X and Y in an episode of a run [deg]."""
    if not hole.tilt_spread_deg:
        return hole.rx_deg, hole.ry_deg
    dx, dy = generator(seed, Role.HOLE_TILT, episode, 0).uniform(-1.0, 1.0, size=2).tolist()
    return hole.rx_deg + hole.tilt_spread_deg * dx, hole.ry_deg + hole.tilt_spread_deg * dy


def standing(hole: Hole, seed: int, episode: int) -> Standing | None:
    """Return how the hole stands in an episode of a run; None for upright."""
    rx_deg, ry_deg = tilt_deg(hole, seed, episode)
    if rx_deg == ry_deg == 0.0:
        return None
    half_x, half_y = math.radians(rx_deg) / 2.0, math.radians(ry_deg) / 2.0
    about_x = (math.cos(half_x), math.sin(half_x), 0.0, 0.0)
    about_y = (math.cos(half_y), 0.0, math.sin(half_y), 0.0)
    return Standing(multiply(about_y, about_x))


def _turned(turn: Quaternion, pose: PoseNumbers) -> PoseNumbers:
    w, x, y, z = turn
    _, px, py, pz = multiply(multiply(turn, (0.0, *pose[:3])), (w, -x, -y, -z))
    return (px, py, pz, *multiply(turn, pose[3:]))
