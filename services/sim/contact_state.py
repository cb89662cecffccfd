"""The true contact state, a name for what touches where; for evaluation only, the learner never sees it.

A touching point has a feature and a direction. Features, by the part of the peg and the depth in the hole:

- ``top``: the tip on the flat face around the mouth;
- ``chamfer``: the tip on the chamfer;
- ``bore``: the tip on the wall of the bore;
- ``mouth``: the side of the peg, mostly on the edge where the bore begins.

The direction is the octant of the point around the hole's axis: 0 is +X of the hole frame, 2 is +Y. A state is the
set of all these, written in order, for example ``bore-2+mouth-6`` for two-point contact, and ``free`` for none.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from services.sim.geometry import Geometry
from services.sim.pose import Pose, Vector, axis

FREE = "free"
LEAST_FORCE_N = 0.02
"""A point that carries less does not count as touching."""
EDGE_MM = 0.1
"""How near the tip's face a point must be to count as the tip, and how near the mouth's plane as the top."""


class ContactPoint(NamedTuple):
    """One point that PhysX reports."""

    position_mm: Vector
    """In the hole frame, shape (3,)."""
    force_n: float
    """Magnitude of what is transmitted there."""


def label(points: Iterable[ContactPoint], geometry: Geometry, tip: Pose) -> str:
    """Name of the contact state for the touching points and the peg's pose in the hole frame."""
    touching = {
        f"{_feature(point.position_mm, geometry, tip)}-{_octant(point.position_mm)}"
        for point in points
        if point.force_n >= LEAST_FORCE_N
    }
    return "+".join(sorted(touching)) if touching else FREE


def _feature(position: Vector, geometry: Geometry, tip: Pose) -> str:
    along = sum((p - t) * a for p, t, a in zip(position, tip.position, axis(tip.orientation), strict=True))
    if along < -EDGE_MM:
        return "mouth"
    if position[2] < EDGE_MM:
        return "top"
    return "chamfer" if position[2] < geometry.chamfer - EDGE_MM else "bore"


def _octant(position: Vector) -> int:
    return round(math.atan2(position[1], position[0]) / (math.pi / 4)) % 8
