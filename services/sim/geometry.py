"""Pure geometry of peg and hole: convex pieces for the physics, and a free-space test that needs no physics.

A hole is a polygon ring: 40 sides for a round hole, 4 for a square or rectangular one, 3 for a triangular one. Its
profile, the distance of the walls from the axis over the depth z, is ``half_width + chamfer`` at the mouth (z = 0),
falls at 45 degrees to ``half_width`` at z = chamfer and stays there. Seen in section the material is convex, so one
convex piece per side holds chamfer and bore together. A rectangle is a square whose sides facing +Y and -Y are nearer
by the same length everywhere. All lengths in mm, all points in the hole frame unless a docstring says otherwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from services.sim.pose import Pose, Vector, axis, rotate
from services.wire.cross_section import CrossSection
from services.wire.definition import Parts

Vertices = npt.NDArray[np.float32]

ROUND_SIDES = 40
"""Sides of the polygons that stand for circles, peg and hole alike; a multiple of 8 keeps every mirror symmetry."""

MARGIN_MM = 0.01
"""What a pose must be clear by before the free-space test calls it free."""


@dataclass(frozen=True)
class Geometry:
    """Sizes of peg and hole [mm] as both the physics and the free-space test use them.

    A round peg's polygon lies inside its circle and a round hole's polygon outside its own, so a contact never comes
    earlier than between the true circles, and later the more the peg is turned about its axis (docs/decisions/0025).
    """

    section: CrossSection
    sides: int
    peg_half_width: float
    """How far the peg's sides are from its axis: its radius, or half the side of a square (of a rectangle along X)."""
    peg_length: float
    """Length of the body that can touch something; more than goes in."""
    hole_half_width: float
    """The same of the bore."""
    chamfer: float
    depth: float
    """Depth of the bore: the peg cannot reach its end."""
    outer: float
    """Half width of the block around the hole."""

    @property
    def is_round(self) -> bool:
        """Whether the polygon stands for a circle."""
        return self.section.is_round

    @property
    def tip_lever(self) -> float:
        """At least half of how far the farthest point of the tip is from its centre [mm]."""
        return max(self.peg_half_width, self.section.radius_mm / 2.0)

    def wall(self, z_mm: float) -> float:
        """Distance of the hole's walls from its axis at depth z >= 0 [mm], as ``CrossSection.aside`` counts it."""
        return self.hole_half_width + max(0.0, self.chamfer - z_mm)


def geometry_of(parts: Parts) -> Geometry:
    """Sizes for one pair of parts.

    The block reaches 45 mm beyond the mouth, more than the widest start offset, so the peg cannot miss it; the bore
    is deeper than the peg is long.
    """
    section = CrossSection(parts)
    hole_half_width = section.half_width_mm + parts.clearance_mm
    peg_length = 2.0 * parts.peg_height_mm + parts.chamfer_mm
    return Geometry(
        section=section,
        sides=ROUND_SIDES if section.is_round else len(section.corners),
        peg_half_width=section.half_width_mm,
        peg_length=peg_length,
        hole_half_width=hole_half_width,
        chamfer=parts.chamfer_mm,
        depth=peg_length + 5.0,
        outer=hole_half_width + parts.chamfer_mm + parts.peg_width_mm + 45.0,
    )


def _corner_directions(sides: int, turn: float = 0.0) -> list[tuple[float, float]]:
    """Unit vectors to the corners of a regular polygon whose first side faces +X, turned by ``turn`` sides about Z."""
    angles = [(2 * i - 1 + 2.0 * turn) * math.pi / sides for i in range(sides)]
    return [(math.cos(angle), math.sin(angle)) for angle in angles]


def hole_pieces(geometry: Geometry) -> list[Vertices]:
    """Convex pieces of the hole, one per side, each the corner points of a convex body, shape (n, 3), hole frame.

    Every piece is the profile's section swept between the two mitre planes of its side, so neighbours share a plane
    and the chamfer of a square hole has true mitred corners.
    """
    outward = 1.0 / math.cos(math.pi / geometry.sides)
    section = [
        (geometry.hole_half_width + geometry.chamfer, 0.0),
        (geometry.outer, 0.0),
        (geometry.outer, geometry.depth),
        (geometry.hole_half_width, geometry.depth),
    ]
    if geometry.chamfer > 0.0:
        section.append((geometry.hole_half_width, geometry.chamfer))
    corners = _corner_directions(geometry.sides)
    pieces = []
    for first, second in zip(corners, corners[1:] + corners[:1], strict=True):
        points = [(r * outward * x, r * outward * y, z) for x, y in (first, second) for r, z in section]
        pieces.append(_narrowed(geometry, points))
    return pieces


def peg_vertices(geometry: Geometry) -> Vertices:
    """Corner points of the peg, a prism, shape (2 * sides, 3), in the tool frame: tip face at z = 0, body behind it."""
    if geometry.is_round:
        # Half a side round, so that the peg's edges meet the middle of the hole's sides and not its corners: an edge
        # lying in a corner has two contacts to choose from, and the solver changes its mind at every step.
        reach, corners = geometry.peg_half_width, _corner_directions(geometry.sides, turn=0.5)
    else:
        outward = 1.0 / math.cos(math.pi / geometry.sides)
        reach, corners = geometry.peg_half_width * outward, _corner_directions(geometry.sides)
    points = [(reach * x, reach * y, z) for z in (0.0, -geometry.peg_length) for x, y in corners]
    return _narrowed(geometry, points)


def _narrowed(geometry: Geometry, points: list[Vector]) -> Vertices:
    """Return corner points of a regular polygon's pieces as they are in a rectangle: nearer to the plane Y = 0."""
    narrower = geometry.section.narrower_mm
    if narrower:
        points = [(x, y - narrower * math.copysign(1.0, y), z) for x, y, z in points]
    return np.array(points, dtype=np.float32)


def clearance(geometry: Geometry, pose: Pose, deepest_mm: float | None = None) -> float:
    """A lower bound of the peg's distance from the hole's walls, measured across the hole's axis [mm].

    The peg counts as endless behind its tip, and only depths from 0 to ``deepest_mm`` count (by default down to the
    peg's deepest point). A cut across the hole at depth z meets a round peg in an ellipse within
    ``|c(z)| + R / cos(tilt)`` of the axis, c(z) being the peg's axis; it meets any other peg in the hull of its
    edge lines. Both reaches are convex in z and the wall is linear between mouth, end of chamfer and deepest point,
    so the least distance is at one of these three. While the tip is in the chamfer, the edge of the tip itself gives
    a better bound than a cut at its deepest point. Infinite when the whole peg is above the mouth.
    """
    lowest = deepest(geometry, pose) if deepest_mm is None else deepest_mm
    if lowest < 0.0:
        return math.inf
    at_mouth = _clearance_at(geometry, pose, 0.0)
    if lowest > geometry.chamfer:
        at_bore = _clearance_at(geometry, pose, geometry.chamfer)
        return min(at_mouth, at_bore, _clearance_at(geometry, pose, lowest))
    return min(at_mouth, max(_clearance_at(geometry, pose, lowest), _tip_clearance(geometry, pose)))


def _tip_corners(geometry: Geometry, pose: Pose) -> list[Vector]:
    """Corners of the tip of a peg that has any, in the hole frame."""
    turned = [rotate(pose.orientation, (x, y, 0.0)) for x, y in geometry.section.corners]
    return [(pose.x_mm + dx, pose.y_mm + dy, pose.z_mm + dz) for dx, dy, dz in turned]


def _clearance_at(geometry: Geometry, pose: Pose, z_mm: float) -> float:
    """Distance of the endless peg from the wall at one depth, a lower bound [mm]."""
    lean_x, lean_y, upright = axis(pose.orientation)
    slope_x, slope_y = lean_x / upright, lean_y / upright
    if geometry.is_round:
        sink = z_mm - pose.z_mm
        reach = math.hypot(pose.x_mm + sink * slope_x, pose.y_mm + sink * slope_y) + geometry.peg_half_width / upright
    else:
        reach = max(
            geometry.section.aside(x + (z_mm - z) * slope_x, y + (z_mm - z) * slope_y)
            for x, y, z in _tip_corners(geometry, pose)
        )
    return geometry.wall(z_mm) - reach


def _tip_clearance(geometry: Geometry, pose: Pose) -> float:
    """Distance of the tip's edge from the cone (or pyramid) of the chamfer, across the axis, a lower bound [mm].

    It is ``wall(0) - max(|r| + z)`` over the edge. For the circle, with n the direction of r and u the peg's axis,
    the maximum over the circle is ``n.c + z + R sqrt(2 - (n.u + u_z)^2)``; the root is concave, so its tangent at
    n.u = 0 bounds it and leaves the maximum over n of something linear in n.
    """
    mouth = geometry.wall(0.0)
    if not geometry.is_round:
        return mouth - max(geometry.section.aside(x, y) + z for x, y, z in _tip_corners(geometry, pose))
    lean_x, lean_y, upright = axis(pose.orientation)
    root = math.sqrt(2.0 - upright * upright)
    pull = geometry.peg_half_width * upright / root
    reach = math.hypot(pose.x_mm - pull * lean_x, pose.y_mm - pull * lean_y)
    return mouth - (reach + geometry.peg_half_width * root + pose.z_mm)


def deepest(geometry: Geometry, pose: Pose) -> float:
    """Depth z of the deepest point of the peg's tip face [mm], negative above the mouth; a bound for a round peg."""
    if geometry.is_round:
        lean_x, lean_y, _ = axis(pose.orientation)
        return pose.z_mm + geometry.peg_half_width * math.hypot(lean_x, lean_y)
    w, x, y, z = pose.orientation
    sink_x, sink_y = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)
    return pose.z_mm + max(cx * sink_x + cy * sink_y for cx, cy in geometry.section.corners)


def is_free_move(geometry: Geometry, start: Pose, end: Pose) -> bool:
    """Whether the peg, rigidly on its commanded path from ``start`` to ``end``, stays clear by ``MARGIN_MM``.

    For a move without rotation the reach is convex in path and depth together, so both ends decide it, provided that
    each is judged down to the depth of the deeper one. A rotation bends the paths of the peg's points; the bound on
    that bend, a quarter of the angle squared times the lever plus angle times shift, is added to the margin. Poses
    tilted by 60 degrees or more are never called free.
    """
    dot = abs(sum(a * b for a, b in zip(start[3:], end[3:], strict=True)))
    angle = 0.0 if start[3:] == end[3:] else 2.0 * math.acos(min(1.0, dot)) + 1e-7
    shift = math.dist(start[:3], end[:3])
    lever = 2.0 * (geometry.tip_lever + abs(start.z_mm) + abs(end.z_mm))
    needed = MARGIN_MM + angle * angle * lever / 4.0 + angle * shift
    lowest = max(deepest(geometry, start), deepest(geometry, end)) + angle * angle * lever / 4.0
    if lowest < -needed:
        return True
    if axis(start.orientation)[2] <= 0.5 or axis(end.orientation)[2] <= 0.5:
        return False
    # Not above by the margin: judge at least at the level of the mouth.
    lowest = max(0.0, lowest)
    return clearance(geometry, start, lowest) > needed and clearance(geometry, end, lowest) > needed
