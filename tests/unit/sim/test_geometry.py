"""Convex pieces and the free-space test, the latter against a brute-force check of the peg's surface."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.sim.geometry import (
    Geometry,
    clearance,
    deepest,
    geometry_of,
    hole_pieces,
    is_free_move,
    peg_vertices,
)
from services.sim.pose import Pose, between, rotate
from services.wire.actions import Increment
from services.wire.definition import Parts

SHAPES: list[Literal["round", "square"]] = ["round", "square"]
GEOMETRIES = [geometry_of(Parts(shape=shape, chamfer_mm=chamfer)) for shape in SHAPES for chamfer in (0.0, 3.0)]

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


def penetration(geometry: Geometry, pose: Pose) -> float:
    """Greatest depth of a point of the peg's mantle or tip in the material, across the axis [mm]; below 0: clear."""
    worst = -math.inf
    corners = peg_vertices(geometry)[: len(peg_vertices(geometry)) // 2]
    for corner in corners.tolist():
        for behind in np.linspace(0.0, 20.0, 41):
            x, y, z = rotate(pose.orientation, (corner[0], corner[1], -behind))
            x, y, z = x + pose.x_mm, y + pose.y_mm, z + pose.z_mm
            if z >= 0.0:
                reach = math.hypot(x, y) if geometry.is_round else max(abs(x), abs(y))
                worst = max(worst, reach - geometry.wall(z))
    return worst


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_the_pieces_leave_the_hole_open_and_close_everything_else(geometry: Geometry) -> None:
    pieces = hole_pieces(geometry)
    assert len(pieces) == geometry.sides
    points = np.concatenate(pieces)
    normals = [2 * math.pi * i / geometry.sides for i in range(geometry.sides)]
    across = np.max([points[:, 0] * math.cos(a) + points[:, 1] * math.sin(a) for a in normals], axis=0)
    walls = np.array([geometry.wall(z) for z in points[:, 2]])
    assert np.all(across >= walls - 1e-4), "a piece reaches into the hole"
    assert across.max() == pytest.approx(geometry.outer, abs=1e-3)
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
    assert np.abs(points[:, 0]).max() == pytest.approx(12.4, abs=1e-4)
    assert points[:, 2].max() == 0.0
    assert points[:, 2].min() == pytest.approx(-geometry.peg_length)
    assert geometry.depth > geometry.peg_length


def test_a_straight_peg_has_the_clearance_of_the_definition() -> None:
    for shape in SHAPES:
        geometry = geometry_of(Parts(shape=shape, clearance_mm=0.5))
        assert clearance(geometry, Pose(0.0, 0.0, 10.0)) == pytest.approx(0.5)
        assert clearance(geometry, Pose(0.1, 0.0, 10.0)) == pytest.approx(0.4)
        assert clearance(geometry, Pose(0.0, 0.0, -0.5)) == math.inf


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
        for fraction in (0.0, 0.25, 0.5, 0.75, 1.0):
            assert penetration(geometry, between(pose, end, fraction)) < 0.0


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
