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

from services.wire.definition import Parts

Points = npt.NDArray[np.float32]

_RIM_MM = 7.0
"""Material shown around the mouth."""
_ROUND_STEPS = 64
_SQUARE_STEPS = 8
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
    bore = parts.peg_width_mm / 2 + parts.clearance_mm
    mouth, depth = bore + parts.chamfer_mm, _depth(parts)
    outer = mouth + _RIM_MM
    section = [(bore, depth), (bore, parts.chamfer_mm), (mouth, 0.0), (outer, 0.0), (outer, depth)]
    around = _directions(parts)
    around = around[: round(_CUT * (len(around) - 1)) + 1]
    quads = [
        [_at(here, p), _at(there, p), _at(there, q), _at(here, q)]
        for here, there in pairwise(around)
        for p, q in zip(section, section[1:] + section[:1], strict=True)
    ]
    # The cut faces; the section is convex, so that a fan from one corner covers it.
    corner = section[-1]
    for direction in (around[0], around[-1]):
        for p, q in pairwise(section[:-1]):
            quads.append([_at(direction, corner), _at(direction, p), _at(direction, q), _at(direction, q)])
    return _mesh(quads)


def peg_mesh(parts: Parts) -> Mesh:
    """Return the peg: a closed prism."""
    half, length = parts.peg_width_mm / 2, peg_length(parts)
    around = _directions(parts)
    section = [(0.0, 0.0), (half, 0.0), (half, -length), (0.0, -length)]
    quads = [
        [_at(here, p), _at(there, p), _at(there, q), _at(here, q)]
        for here, there in pairwise(around)
        for p, q in pairwise(section)
    ]
    return _mesh(quads)


def peg_outline(parts: Parts) -> list[Points]:
    """Return lines that show how the peg is turned: edges of tip and back, one line along the body, and the axis."""
    half, length = parts.peg_width_mm / 2, peg_length(parts)
    around = _directions(parts)
    lines = [[_at(direction, (half, z)) for direction in around] for z in (0.0, -length)]
    lines.append([_at(around[-2], (half, 0.0)), _at(around[-2], (half, -length))])
    lines.append([(0.0, 0.0, 0.0), (0.0, 0.0, -length)])
    return [np.array(line, dtype=np.float32) for line in lines]


def peg_length(parts: Parts) -> float:
    """Length of the peg as shown [mm]: more than goes in, so that its end stays in sight."""
    return 1.5 * parts.peg_height_mm


def _depth(parts: Parts) -> float:
    return parts.peg_height_mm + parts.chamfer_mm


Place = tuple[float, float, float]
Quad = list[Place]


def _directions(parts: Parts) -> list[tuple[float, float]]:
    """Return where a profile of radius 1 goes on its way round: from +X by +Y back to +X."""
    steps = _ROUND_STEPS if parts.shape == "round" else _SQUARE_STEPS
    angles = [2 * math.pi * step / steps for step in range(steps + 1)]
    around = [(math.cos(angle), math.sin(angle)) for angle in angles]
    if parts.shape == "square":
        around = [(x / max(abs(x), abs(y)), y / max(abs(x), abs(y))) for x, y in around]
    return around


def _at(direction: tuple[float, float], profile: tuple[float, float]) -> Place:
    return (profile[0] * direction[0], profile[0] * direction[1], profile[1])


def _mesh(quads: list[Quad]) -> Mesh:
    """Return quads as triangles, leaving out those without area (a quad may repeat a corner)."""
    corners = np.array(quads, dtype=np.float64)
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    sizes = np.linalg.norm(normals, axis=1)
    solid = sizes > 1e-9
    normals = np.repeat(normals[solid] / sizes[solid, None], 3, axis=0)
    return Mesh(triangles[solid].reshape(-1, 3).astype(np.float32), normals.astype(np.float32))
