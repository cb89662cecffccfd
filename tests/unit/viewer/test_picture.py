"""Shapes, colours and layout: what is drawn is where and what it says."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import rerun.blueprint as rrb
from hypothesis import given
from hypothesis import strategies as st

from services.viewer import colours, layout, record
from services.viewer.service import invitation
from services.viewer.shapes import Mesh, hole_mesh, peg_length, peg_mesh, peg_outline
from services.viewer.stream import free_port
from services.wire.definition import Parts
from services.wire.errors import CellError

SQUARE = Parts(shape="square", clearance_mm=0.2, peg_height_mm=13.3)
CHAMFERLESS = Parts(chamfer_mm=0.0)
RECTANGLE = Parts(shape="rectangle", peg_breadth_mm=14.0)
UPRIGHT = Parts(shape="rectangle", peg_width_mm=12.0, peg_breadth_mm=24.8)
TRIANGLE = Parts(shape="triangle")
PARTS = [Parts(), SQUARE, CHAMFERLESS, RECTANGLE, UPRIGHT, TRIANGLE]
AREAS_MM2 = [math.pi * 12.4**2, 24.8**2, math.pi * 12.4**2, 24.8 * 14.0, 12.0 * 24.8, 24.8**2 * math.sqrt(3) / 4]


def volume(mesh: Mesh) -> float:
    """Volume that the triangles enclose, whichever way they are wound."""
    a, b, c = (mesh.corners.reshape(-1, 3, 3)[:, corner].astype(np.float64) for corner in range(3))
    return abs(float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6))


@pytest.mark.parametrize(("parts", "area"), list(zip(PARTS, AREAS_MM2, strict=True)))
def test_the_peg_is_a_closed_prism_behind_its_tip(parts: Parts, area: float) -> None:
    mesh = peg_mesh(parts)
    assert volume(mesh) == pytest.approx(area * peg_length(parts), rel=0.01)
    assert mesh.corners[:, 2].max() == 0.0
    assert mesh.corners[:, 2].min() == pytest.approx(-peg_length(parts))


@pytest.mark.parametrize("parts", PARTS)
def test_the_hole_keeps_its_clearance_and_lets_the_peg_be_seen(parts: Parts) -> None:
    corners = hole_mesh(parts).corners
    # The least distance of its corners from the axis: of the places on the way round, that in the middle of a side.
    nearest = min(parts.peg_width_mm, parts.peg_breadth_mm or parts.peg_width_mm) / 2
    if parts.shape == "triangle":
        nearest = parts.peg_width_mm / math.sqrt(12.0)
    across = np.hypot(corners[:, 0], corners[:, 1])
    assert across.min() == pytest.approx(nearest + parts.clearance_mm, rel=1e-5)
    at_mouth = across[corners[:, 2] == 0.0]
    assert at_mouth.min() == pytest.approx(nearest + parts.clearance_mm + parts.chamfer_mm, rel=1e-5)
    assert corners[:, 2].min() == 0.0
    assert not ((corners[:, 0] > 0.1) & (corners[:, 1] < -0.1)).any(), "the quarter towards the eye is cut away"


@pytest.mark.parametrize("parts", PARTS)
@pytest.mark.parametrize("make", [peg_mesh, hole_mesh])
def test_normals_are_unit_vectors_across_their_triangle(parts: Parts, make: Callable[[Parts], Mesh]) -> None:
    mesh = make(parts)
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(np.ones(len(mesh.normals)), abs=1e-5)
    triangles = mesh.corners.reshape(-1, 3, 3)
    edges = triangles[:, 1] - triangles[:, 0]
    assert np.abs((edges * mesh.normals[::3]).sum(axis=1)).max() < 1e-3


def test_the_outline_lies_on_the_peg() -> None:
    parts = Parts()
    for strip in peg_outline(parts)[:3]:
        assert np.hypot(strip[:, 0], strip[:, 1]) == pytest.approx(np.full(len(strip), 12.4), abs=1e-4)


def test_colours_rise_in_lightness_and_leave_the_unknown_grey() -> None:
    values = np.linspace(-5.0, 3.0, 50)[None, :]
    known = np.ones((1, 50), dtype=np.bool_)
    known[0, 7] = False
    pixels = colours.viridis(values, known)
    assert tuple(pixels[0, 7]) == colours.UNKNOWN
    lightness = pixels[0, known[0]].astype(float) @ (0.2126, 0.7152, 0.0722)
    assert (np.diff(lightness) > 0).all()
    assert pixels[0, 0].tolist() == [68, 1, 84]
    assert pixels[0, -1].tolist() == [253, 231, 37]


def test_equal_values_and_no_values_have_a_colour() -> None:
    same = colours.viridis(np.zeros((2, 3)), np.ones((2, 3), dtype=np.bool_))
    assert len(np.unique(same.reshape(-1, 3), axis=0)) == 1
    none = colours.viridis(np.zeros((2, 3)), np.zeros((2, 3), dtype=np.bool_))
    assert (none == colours.UNKNOWN).all()


@given(st.integers(1, 66), st.integers(1, 120))
def test_stretching_puts_every_cell_where_its_label_is(rows: int, columns: int) -> None:
    cells = (np.arange(rows * columns) % 251).astype(np.uint8).reshape(rows, columns, 1).repeat(3, axis=2)
    pixels = colours.stretched(cells, 198, 360)
    assert pixels.shape == (198, 360, 3)
    middles = (np.arange(columns) * 2 + 1) * 360 // (2 * columns), (np.arange(rows) * 2 + 1) * 198 // (2 * rows)
    assert (pixels[np.ix_(middles[1], middles[0])] == cells).all()


def views(part: rrb.View | rrb.Container) -> list[rrb.View]:
    """All views in a part of a layout."""
    if isinstance(part, rrb.View):
        return [part]
    return [view for inner in part.contents for view in views(inner)]


def test_the_layout_shows_every_entity_and_names_every_view() -> None:
    shown = views(layout.blueprint().root_container)
    origins = {str(view.origin).strip("/") for view in shown}
    recorded = {record.FORCE, record.TORQUE, record.MAGNITUDE, record.STATE, record.ACTION, record.REWARD}
    assert origins == recorded | {
        record.RETURN,
        record.FAILURES,
        record.RUN,
        record.LOG,
        record.ABOUT,
        "scene",
        "agent",
    }
    assert all(view.name for view in shown)


def test_curves_of_one_plot_differ_in_colour() -> None:
    for columns in layout.STYLES.values():
        assert len({colour for _, colour in columns}) == len(columns)


def test_a_port_of_ones_own_choice_is_free() -> None:
    assert free_port("127.0.0.1", 0) > 0


def test_the_invitation_names_an_address_that_can_be_connected_to() -> None:
    stream = "rerun rerun+http"
    assert invitation(stream, "10.1.2.3", 9000, "/proxy") == "rerun rerun+http://10.1.2.3:9000/proxy"
    assert invitation(stream, "fd00::1", 9000, "/proxy") == "rerun rerun+http://[fd00::1]:9000/proxy"
    assert "rerun+http://127.0.0.1:9876/proxy " in invitation(stream, "0.0.0.0", 9876, "/proxy")
    assert invitation("http", "::", 9090).startswith("http://127.0.0.1:9090 ")


@pytest.mark.parametrize(("bind", "port"), [("127.0.0.1", 70000), ("no such host.", 0), ("192.0.2.1", 0)])
def test_where_one_cannot_listen_is_said(bind: str, port: int) -> None:
    with pytest.raises(CellError, match=r"^viewer: expected a free port at "):
        free_port(bind, port)
