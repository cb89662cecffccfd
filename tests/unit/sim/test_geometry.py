"""Convex pieces and the free-space test, the latter against a brute-force check of the peg's surface."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from services.sim.geometry import (
    Geometry,
    clearance,
    deepest,
    geometry_of,
    hole_pieces,
    is_free_move,
    peg_vertices,
)
from services.sim.pose import Pose, rotate, way
from services.wire.actions import Increment
from services.wire.definition import Parts
from services.wire.definition_file import load

Floats = npt.NDArray[np.floating]
SHAPES = {
    "round": Parts(),
    "square": Parts(shape="square"),
    "rectangle": Parts(shape="rectangle", peg_breadth_mm=14.0),
    "upright": Parts(shape="rectangle", peg_width_mm=12.0, peg_breadth_mm=24.8),
    "triangle": Parts(shape="triangle"),
}
GEOMETRIES = [geometry_of(replace(parts, chamfer_mm=chamfer)) for parts in SHAPES.values() for chamfer in (0.0, 3.0)]
SIXTY = math.radians(60.0)
SIDES: dict[str, list[tuple[float, float]]] = {
    "square": [(0.0, 12.4), (90.0, 12.4), (180.0, 12.4), (270.0, 12.4)],
    "rectangle": [(0.0, 12.4), (90.0, 7.0), (180.0, 12.4), (270.0, 7.0)],
    "upright": [(0.0, 6.0), (90.0, 12.4), (180.0, 6.0), (270.0, 12.4)],
    "triangle": [(angle, 12.4 * math.tan(SIXTY / 2)) for angle in (0.0, 120.0, 240.0)],
}
"""Of each peg the direction of each side's normal [deg] and the distance of the side from the axis [mm], by hand."""

small = st.floats(-3.5, 3.5)
poses = st.builds(Pose.from_tilt, small, small, st.floats(-2, 15), st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3))
gentle_poses = st.builds(
    Pose.from_tilt,
    st.floats(-0.3, 0.3),
    st.floats(-0.3, 0.3),
    st.floats(-2, 12),
    st.floats(-0.5, 0.5),
    st.floats(-0.5, 0.5),
    st.floats(-0.5, 0.5),
)
step = st.floats(-0.2, 0.2)
increments = st.builds(Increment, step, step, step, step, step, step)


NAMES = {id(geometry): name for geometry, name in zip(GEOMETRIES, np.repeat(list(SHAPES), 2).tolist(), strict=True)}
SIDES["round"] = [(9.0 * i, 12.4) for i in range(40)]


def beyond(geometry: Geometry, x: Floats, y: Floats) -> Floats:
    """How far points are outside the outline of the peg [mm], along the normal of a side; of the circle for a round."""
    if geometry.is_round:
        return np.hypot(x, y) - 12.4
    sides = ((math.radians(angle), distance) for angle, distance in SIDES[NAMES[id(geometry)]])
    over: Floats = np.max([x * math.cos(angle) + y * math.sin(angle) - distance for angle, distance in sides], axis=0)
    return over


def penetration(geometry: Geometry, pose: Pose) -> float:
    """Greatest depth of a point of the peg's mantle or tip in the material, across the axis [mm]; below 0: clear."""
    corners = peg_vertices(geometry)[: geometry.sides]
    edges = np.array([[rotate(pose.orientation, (x, y, 0.0)) for x, y, _ in corners.tolist()]])
    behind = np.array([rotate(pose.orientation, (0.0, 0.0, -length)) for length in np.linspace(0.0, 20.0, 41).tolist()])
    x, y, z = (edges + behind[:, None, :] + np.array(pose.position)).reshape(-1, 3).T
    over = beyond(geometry, x, y) - 0.5 - np.maximum(0.0, geometry.chamfer - z)
    return float(over[z >= 0.0].max(initial=-math.inf))


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_the_pieces_leave_the_hole_open_and_close_everything_else(geometry: Geometry) -> None:
    pieces = hole_pieces(geometry)
    assert len(pieces) == geometry.sides
    points = np.concatenate(pieces)
    normals = [(math.radians(angle), distance) for angle, distance in SIDES[NAMES[id(geometry)]]]
    across = np.max([points[:, 0] * math.cos(a) + points[:, 1] * math.sin(a) - d for a, d in normals], axis=0)
    gaps = 0.5 + np.maximum(0.0, geometry.chamfer - points[:, 2])
    assert np.all(across >= gaps - 1e-4), "a piece reaches into the hole"
    assert across.max() == pytest.approx(geometry.outer - geometry.peg_half_width, abs=1e-3)
    # Each side's own piece lies on it all the way from corner to corner, so that no gap is left at a corner.
    for piece, (angle, distance) in zip(pieces, normals, strict=True):
        inner = piece[:, 0] * math.cos(angle) + piece[:, 1] * math.sin(angle) - distance
        assert np.allclose(np.sort(inner)[:2], 0.5, atol=1e-4)
    assert points[:, 2].min() == 0.0
    assert points[:, 2].max() == pytest.approx(geometry.depth)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_neighbouring_pieces_share_a_plane(geometry: Geometry) -> None:
    pieces = hole_pieces(geometry)
    for first, second in zip(pieces, pieces[1:] + pieces[:1], strict=True):
        half = len(first) // 2
        assert np.allclose(first[half:], second[:half], atol=1e-4)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_the_peg_has_its_width_and_its_tip_at_zero(geometry: Geometry) -> None:
    points = peg_vertices(geometry)
    assert beyond(geometry, points[:, 0], points[:, 1]) == pytest.approx(0.0, abs=1e-5)
    assert len({(round(x, 3), round(y, 3)) for x, y, _ in points.tolist()}) == geometry.sides
    assert points[:, 2].max() == 0.0
    assert points[:, 2].min() == pytest.approx(-geometry.peg_length)
    assert geometry.depth > geometry.peg_length


def test_a_straight_peg_has_the_clearance_of_the_definition() -> None:
    for parts in SHAPES.values():
        geometry = geometry_of(parts)
        assert clearance(geometry, Pose(0.0, 0.0, 10.0)) == pytest.approx(0.5)
        assert clearance(geometry, Pose(0.1, 0.0, 10.0)) == pytest.approx(0.4)
        assert clearance(geometry, Pose(0.0, 0.0, -0.5)) == math.inf


def test_a_triangle_has_room_by_the_normals_of_its_sides() -> None:
    """Towards a corner two sides share the shift, half of it each; away from it the side behind takes all of it."""
    geometry = geometry_of(Parts(shape="triangle", clearance_mm=0.5))
    assert geometry.peg_half_width == pytest.approx(24.8 / math.sqrt(12.0))
    assert clearance(geometry, Pose(-0.4, 0.0, 10.0)) == pytest.approx(0.5 - 0.2)
    assert clearance(geometry, Pose(0.4, 0.0, 10.0)) == pytest.approx(0.5 - 0.4)
    assert clearance(geometry, Pose(0.0, 0.3, 10.0)) == pytest.approx(0.5 - 0.3 * math.cos(math.radians(30.0)))


def test_a_rectangle_has_the_same_room_on_all_sides() -> None:
    geometry = geometry_of(Parts(shape="rectangle", peg_breadth_mm=14.0, clearance_mm=0.5))
    for shift in (0.3, -0.3):
        assert clearance(geometry, Pose(shift, 0.0, 10.0)) == pytest.approx(0.2)
        assert clearance(geometry, Pose(0.0, shift, 10.0)) == pytest.approx(0.2)
    # Turned by 1 deg the long side's ends come nearer to the short walls' planes by 12.4 mm times the sine.
    turned = clearance(geometry, Pose.from_tilt(0.0, 0.0, 10.0, 0.0, 0.0, 1.0))
    angle = math.radians(1.0)
    assert turned == pytest.approx(7.5 - 7.0 * math.cos(angle) - 12.4 * math.sin(angle))


@given(st.sampled_from(GEOMETRIES), poses | gentle_poses)
def test_clearance_never_promises_more_than_there_is(geometry: Geometry, pose: Pose) -> None:
    bound = clearance(geometry, pose)
    if bound > 1e-9:
        # Exact up to the cosine of the tilt, as the brute-force check measures across the hole's axis too.
        assert penetration(geometry, pose) <= -bound + 1e-3


@given(st.sampled_from(GEOMETRIES), poses)
def test_no_corner_is_deeper_than_deepest(geometry: Geometry, pose: Pose) -> None:
    bound = deepest(geometry, pose)
    for corner in peg_vertices(geometry).tolist():
        assert pose.z_mm + rotate(pose.orientation, tuple(corner))[2] <= bound + 1e-5


@given(st.sampled_from(GEOMETRIES), poses | gentle_poses, increments)
def test_a_free_move_is_free_all_along(geometry: Geometry, pose: Pose, increment: Increment) -> None:
    end = pose.moved(increment)
    if is_free_move(geometry, pose, end):
        for passed in (pose, *(Pose(*numbers) for numbers in way(pose, end, 4, 0.0)), end):
            assert penetration(geometry, passed) < 0.0


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_going_straight_into_the_middle_is_free(geometry: Geometry) -> None:
    pose = Pose(0.0, 0.0, -1.0)
    while pose.z_mm < 14.7:
        end = pose.moved(Increment(dz_mm=0.2))
        assert is_free_move(geometry, pose, end)
        pose = end


def test_what_touches_is_not_free() -> None:
    geometry = geometry_of(Parts())
    above, below = Pose(25.0, 0.0, -0.05), Pose(25.0, 0.0, 0.15)
    assert not is_free_move(geometry, above, below)
    assert not is_free_move(geometry, below, above)
    assert not is_free_move(geometry, Pose(0.0, 0.0, 8.0), Pose(0.5, 0.0, 8.0))


def test_a_pose_upside_down_is_never_called_free() -> None:
    geometry = geometry_of(Parts())
    pose = Pose.from_tilt(0.0, 0.0, 5.0, 170.0, 0.0, 0.0)
    assert not is_free_move(geometry, pose, pose)


def overlaps(geometry: Geometry, pose: Pose, corners: int, circles: bool) -> float:
    """Greatest depth [mm] of a round peg of so many corners in a hole of true circles, or in its polygon."""
    angles = 2 * math.pi * np.arange(corners) / corners
    behind = np.concatenate([[0.0], np.linspace(0.0, pose.z_mm + 1.0, 30)])
    ring = geometry.peg_half_width * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = np.array([(x, y, -length) for length in behind.tolist() for x, y in ring.tolist()])
    turn = np.array([rotate(pose.orientation, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))])
    x, y, z = (points @ turn + np.array(pose.position)).T
    facets = 2 * math.pi * np.arange(geometry.sides) / geometry.sides
    across = np.hypot(x, y) if circles else np.max([x * math.cos(a) + y * math.sin(a) for a in facets], axis=0)
    depth = across - geometry.hole_half_width - np.maximum(0.0, geometry.chamfer - z)
    return float(depth[z >= 0.0].max())


@pytest.mark.parametrize("name", ["suite-round-fine", "suite-industreal-round-4"])
def test_a_polygon_touches_hardly_later_than_a_circle(name: str) -> None:
    """Near a contact, turned and tilted as the suite's episodes start: a twentieth of the clearance later."""
    parts = load(name).parts
    geometry, dice = geometry_of(parts), np.random.default_rng(1)
    late: list[float] = []
    while len(late) < 150:
        z = float(dice.uniform(0.1, geometry.chamfer + 6.0))
        room = 0.7 * (parts.clearance_mm + max(0.0, geometry.chamfer - z))
        x, y, rx, ry, rz = dice.uniform(-1.0, 1.0, 5).tolist()
        pose = Pose.from_tilt(room * x, room * y, z, 1.5 * rx, 1.5 * ry, 1.5 * rz)
        exact = overlaps(geometry, pose, 720, circles=True)
        if abs(exact) < 0.1:
            late.append((exact - overlaps(geometry, pose, geometry.sides, circles=False)) / parts.clearance_mm)
    assert min(late) > -0.005, "never earlier, but for the 720 corners that stand for a circle here"
    assert np.quantile(late, 0.5) < 0.05
    assert np.quantile(late, 0.95) < 0.15
    assert max(late) < 0.35
