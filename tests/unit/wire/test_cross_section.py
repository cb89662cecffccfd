"""The outline of peg and hole, against coordinates worked out by hand."""

from __future__ import annotations

import math

import pytest

from services.wire.cross_section import CrossSection
from services.wire.definition import Parts

ROOT3 = math.sqrt(3.0)


def test_an_equilateral_triangle_has_its_side_and_faces_x() -> None:
    section = CrossSection(Parts(shape="triangle", peg_width_mm=6.0))
    a, b, c = section.corners
    assert a == pytest.approx((ROOT3, 3.0))
    assert b == pytest.approx((-2.0 * ROOT3, 0.0))
    assert c == pytest.approx((ROOT3, -3.0))
    assert [math.dist(a, b), math.dist(b, c), math.dist(c, a)] == pytest.approx([6.0] * 3)
    assert (section.half_width_mm, section.radius_mm) == pytest.approx((ROOT3, 2.0 * ROOT3))


def test_a_rectangle_has_its_sides_along_x_and_y() -> None:
    section = CrossSection(Parts(shape="rectangle", peg_width_mm=8.0, peg_breadth_mm=6.0))
    assert section.corners == ((4.0, 3.0), (-4.0, 3.0), (-4.0, -3.0), (4.0, -3.0))
    assert (section.half_width_mm, section.narrower_mm, section.radius_mm) == (4.0, 1.0, 5.0)


@pytest.mark.parametrize(
    ("parts", "point", "outside"),
    [
        (Parts(peg_width_mm=10.0), (3.0, 4.0), 0.0),
        (Parts(shape="square", peg_width_mm=10.0), (3.0, -7.0), 2.0),
        (Parts(shape="rectangle", peg_width_mm=10.0, peg_breadth_mm=4.0), (0.0, -3.0), 1.0),
        (Parts(shape="rectangle", peg_width_mm=10.0, peg_breadth_mm=4.0), (6.5, 1.0), 1.5),
        (Parts(shape="rectangle", peg_width_mm=4.0, peg_breadth_mm=10.0), (0.0, 6.0), 1.0),
        (Parts(shape="triangle", peg_width_mm=6.0), (ROOT3 + 1.0, 0.0), 1.0),
        (Parts(shape="triangle", peg_width_mm=6.0), (-2.0 * ROOT3 - 2.0, 0.0), 1.0),
        (Parts(shape="triangle", peg_width_mm=6.0), (0.0, 2.0), ROOT3 - ROOT3),
    ],
)
def test_a_point_is_outside_by_the_normal_of_its_side(parts: Parts, point: tuple[float, float], outside: float) -> None:
    section = CrossSection(parts)
    assert section.aside(*point) - section.half_width_mm == pytest.approx(outside)
