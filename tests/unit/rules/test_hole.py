"""A tilted hole: how it stands, and poses as it sees them."""

from __future__ import annotations

import math

import pytest

from services.rules.hole import Standing, standing
from services.wire.definition_world import Hole

UPRIGHT = (1.0, 0.0, 0.0, 0.0)


def stands(hole: Hole, seed: int = 0, episode: int = 0) -> Standing:
    there = standing(hole, seed, episode)
    assert there is not None
    return there


def test_an_upright_hole_sees_what_the_cell_sees() -> None:
    assert standing(Hole(), 3, 4) is None


def test_a_straight_peg_is_tilted_the_other_way_for_a_tilted_hole() -> None:
    """Tilted by 10 degrees about Y the hole's axis points towards +X; what is above its mouth is beside its axis."""
    sine, cosine = math.sin(math.radians(10.0)), math.cos(math.radians(10.0))
    x, y, z, *turn = stands(Hole(ry_deg=10.0)).in_hole((0.0, 0.0, -2.0, *UPRIGHT))
    assert (x, y, z) == pytest.approx((2.0 * sine, 0.0, -2.0 * cosine))
    assert turn == pytest.approx([math.cos(math.radians(5.0)), 0.0, -math.sin(math.radians(5.0)), 0.0])
    x, y, z, *turn = stands(Hole(rx_deg=10.0)).in_hole((0.0, 3.0, 0.0, *UPRIGHT))
    assert (x, y, z) == pytest.approx((0.0, 3.0 * cosine, -3.0 * sine))


def test_the_cell_sees_again_what_it_showed_the_hole() -> None:
    there = stands(Hole(rx_deg=4.0, ry_deg=-7.0, tilt_spread_deg=1.0), 5, 6)
    pose = (1.0, -2.0, 3.0, 0.5, 0.5, -0.5, 0.5)
    assert there.in_cell(there.in_hole(pose)) == pytest.approx(pose)


def test_a_spread_tilt_belongs_to_seed_and_episode_and_fills_its_range() -> None:
    hole = Hole(rx_deg=2.0, tilt_spread_deg=1.5)
    assert stands(hole, 1, 2) == stands(hole, 1, 2)
    assert len({stands(hole, seed, episode) for seed in range(5) for episode in range(20)}) == 100
    tilts = []
    for episode in range(300):
        w, x, _, _ = stands(hole, 7, episode).turn
        tilts.append(math.degrees(2.0 * math.atan2(x, w)))
    assert 0.5 <= min(tilts) < 0.6
    assert 3.4 < max(tilts) <= 3.5
    assert hole.most_deg == (3.5, 1.5)
