"""Peg and hole as triangles, for looking at: the hole with a quarter cut away, so that the insertion can be seen.

Frames as in ``services.wire.definition``: the hole stands in the hole frame, its mouth at z = 0 and +Z into it; the peg
in the tool frame, its tip face at z = 0 and its body behind it (z < 0). Millimetres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from msgspec.structs import replace

from services.wire.cross_section import CrossSection
from services.wire.definition import Parts

Points = npt.NDArray[np.float32]

_RIM_MM = 7.0
"""Material shown around the mouth."""
_STEPS = {"round": 64, "square": 8, "rectangle": 8, "triangle": 12}
"""Places on the way round: multiples of 4, so that the cut is where they are, with every corner among them."""
_CUT = 0.75
"""Part of the way round that the hole is shown for: the quarter from -Y to +X is open."""


@dataclass(frozen=True)
class Mesh:
    """Triangles, each with corners of its own so that faces are shaded flat; three rows a triangle."""

    corners: Points
    """Shape (3 * triangles, 3) [mm]."""
    normals: Points
    """Unit vectors of the same shape."""


def hole_mesh(parts: Parts) -> Mesh:
    """Return the hole: bore, chamfer and the material around them."""
    section = CrossSection(parts)
    bore = section.half_width_mm + parts.clearance_mm
    mouth, depth = bore + parts.chamfer_mm, _depth(parts)
    outer = mouth + _RIM_MM
    profile = [(bore, depth), (bore, parts.chamfer_mm), (mouth, 0.0), (outer, 0.0), (outer, depth)]
    around = _directions(parts)
    around = around[: round(_CUT * (len(around) - 1)) + 1]
    quads = [
        [_at(here, p), _at(there, p), _at(there, q), _at(here, q)]
        for here, there in pairwise(around)
        for p, q in zip(profile, profile[1:] + profile[:1], strict=True)
    ]
    # The cut faces; the profile is convex, so that a fan from one corner covers it.
    corner = profile[-1]
    for direction in (around[0], around[-1]):
        for p, q in pairwise(profile[:-1]):
            quads.append([_at(direction, corner), _at(direction, p), _at(direction, q), _at(direction, q)])
    return _mesh(quads)


def peg_mesh(parts: Parts) -> Mesh:
    """Return the peg: a closed prism."""
    half, length = CrossSection(parts).half_width_mm, peg_length(parts)
    around = _directions(parts)
    profile = [(0.0, 0.0), (half, 0.0), (half, -length), (0.0, -length)]
    quads = [
        [_at(here, p), _at(there, p), _at(there, q), _at(here, q)]
        for here, there in pairwise(around)
        for p, q in pairwise(profile)
    ]
    return _mesh(quads)


def peg_outline(parts: Parts) -> list[Points]:
    """Return lines that show how the peg is turned: edges of tip and back, one line along the body, and the axis."""
    half, length = CrossSection(parts).half_width_mm, peg_length(parts)
    around = _directions(parts)
    lines = [[_at(direction, (half, z)) for direction in around] for z in (0.0, -length)]
    edge = around[-2]
    lines.append([_at(edge, (half, 0.0)), _at(edge, (half, -length))])
    lines.append([(0.0, 0.0, 0.0), (0.0, 0.0, -length)])
    return [np.array(line, dtype=np.float32) for line in lines]


def peg_length(parts: Parts) -> float:
    """Length of the peg as shown [mm]: more than goes in, so that its end stays in sight."""
    return 1.5 * parts.peg_height_mm


def _depth(parts: Parts) -> float:
    return parts.peg_height_mm + parts.chamfer_mm


Place = tuple[float, float, float]
Quad = list[Place]


@dataclass(frozen=True)
class _Direction:
    """A way out from the axis: x = x_per_mm * d and y = y_per_mm * d - nearer for the outline d mm from the axis."""

    x_per_mm: float
    y_per_mm: float
    nearer_mm: float


def _directions(parts: Parts) -> list[_Direction]:
    """Return where an outline is on its way round: from +X by +Y back to +X."""
    section, steps = CrossSection(parts), _STEPS[parts.shape]
    round_of = replace(parts, shape="square", peg_breadth_mm=0.0) if parts.shape == "rectangle" else parts
    regular, around = CrossSection(round_of), []
    for step in range(steps + 1):
        angle = 2 * math.pi * step / steps
        x, y = math.cos(angle), math.sin(angle)
        away = regular.aside(x, y)
        # A rectangle is a square whose sides facing +Y and -Y are nearer.
        on_side = 0.0 if abs(y) < 0.5 * away else section.narrower_mm * math.copysign(1.0, y)
        around.append(_Direction(x / away, y / away, on_side))
    return around


def _at(direction: _Direction, profile: tuple[float, float]) -> Place:
    away, z = profile
    if away == 0.0:
        return (0.0, 0.0, z)
    return (away * direction.x_per_mm, away * direction.y_per_mm - direction.nearer_mm, z)


def _mesh(quads: list[Quad]) -> Mesh:
    """Return quads as triangles, leaving out those without area (a quad may repeat a corner)."""
    corners = np.array(quads, dtype=np.float64)
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    sizes = np.linalg.norm(normals, axis=1)
    solid = sizes > 1e-9
    normals = np.repeat(normals[solid] / sizes[solid, None], 3, axis=0)
    return Mesh(triangles[solid].reshape(-1, 3).astype(np.float32), normals.astype(np.float32))
