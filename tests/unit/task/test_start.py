"""Where an episode starts: as given, or spread about it as seed and episode say."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from services.rules.guard import Guard
from services.task.insertion import Insertion
from services.wire.definition import Definition, Start
from services.wire.definition_file import definition_sha256, load
from services.wire.errors import DefinitionError
from services.wire.messages import Home

Make = Callable[..., Any]
RUN = "test-s0"


def test_without_spread_every_episode_starts_at_the_pose_given(exact: Make) -> None:
    start = Start(x_mm=1.5, y_mm=-2.0, height_mm=1.25, rx_deg=1.75, ry_deg=0.5, rz_deg=-0.25)
    task = Insertion(exact(start=start), RUN, 5)
    for episode in (0, 1, 999):
        assert task.home(episode, 0) == Home(
            run=RUN, episode=episode, x_mm=1.5, y_mm=-2.0, z_mm=-1.25, rx_deg=1.75, ry_deg=0.5, rz_deg=-0.25
        )


POSE = ("x_mm", "y_mm", "z_mm", "rx_deg", "ry_deg", "rz_deg")
SPREAD = Start(x_mm=1.0, y_mm=-2.0, height_mm=1.0, rx_deg=3.0, ry_deg=0.0, xy_spread_mm=0.5, tilt_spread_deg=2.0)


def pose_of(home: Home) -> tuple[float, ...]:
    return tuple(getattr(home, name) for name in POSE)


@given(seed=st.integers(0, 2**63 - 1), episode=st.integers(0, 10**6))
@settings(max_examples=50, deadline=None)
def test_a_spread_start_stays_in_its_range(seed: int, episode: int) -> None:
    home = Insertion(Definition(name="spread", start=SPREAD), RUN, seed).home(episode, 0)
    centre = (1.0, -2.0, -1.0, 3.0, 0.0, 0.0)
    for value, middle, half in zip(pose_of(home), centre, (0.5, 0.5, 0.0, 2.0, 2.0, 2.0), strict=True):
        assert abs(value - middle) <= half


def test_a_spread_start_fills_its_range_on_both_sides(exact: Make) -> None:
    task = Insertion(exact(start=SPREAD), RUN, 0)
    poses = [pose_of(task.home(episode, 0)) for episode in range(200)]
    for axis, half in ((0, 0.5), (1, 0.5), (3, 2.0), (4, 2.0), (5, 2.0)):
        values = [pose[axis] for pose in poses]
        assert max(values) - min(values) > 1.9 * half
        assert len(set(values)) == len(values)


def test_a_spread_start_depends_on_seed_and_episode_only(bench: Make) -> None:
    fresh, used = bench(start=SPREAD, seed=3), bench(start=SPREAD, seed=3, move_limit=50)
    used.home(0, 0)
    used.feel(1.0)
    used.touch(0, 1.0)
    assert used.home(7, 99) == fresh.home(7, 0)
    assert pose_of(fresh.home(7)) != pose_of(fresh.home(8))
    assert pose_of(bench(start=SPREAD, seed=4).home(7)) != pose_of(fresh.home(7))


@given(seed=st.integers(0, 2**63 - 1), episode=st.integers(0, 10**6), decimals=st.integers(1, 9))
@settings(max_examples=50, deadline=None)
def test_a_start_is_rounded_to_what_a_robot_is_told_and_stays_in_its_range(
    seed: int, episode: int, decimals: int
) -> None:
    drawn, rounded = (
        pose_of(Insertion(Definition(name="spread", start=start), RUN, seed).home(episode, 0))
        for start in (SPREAD, replace(SPREAD, decimals=decimals))
    )
    assert rounded == tuple(round(value, decimals) for value in drawn)
    home = Home(run=RUN, episode=episode, **dict(zip(POSE, rounded, strict=True)))
    assert Guard(Definition(name="spread", start=replace(SPREAD, decimals=decimals))).homing(home) is None


def test_a_start_of_more_decimals_than_it_is_rounded_to_is_refused() -> None:
    with pytest.raises(
        DefinitionError, match=r"start\.x_mm: expected no more decimals than start\.decimals = 2, got 1\.234"
    ):
        load("suite-round", ["start.decimals=2", "start.x_mm=1.234"])
    assert load("suite-round", ["start.decimals=3", "start.x_mm=1.234"]).start.decimals == 3


def test_a_run_from_before_starts_were_rounded_keeps_its_name() -> None:
    assert definition_sha256(load("initial", ["start.decimals=0"])) == definition_sha256(load("initial"))
    assert definition_sha256(load("initial", ["start.decimals=4"])) != definition_sha256(load("initial"))


APART = Start(
    x_mm=0.0,
    y_mm=0.0,
    rx_deg=0.0,
    ry_deg=0.0,
    xy_spread_mm=0.5,
    tilt_spread_deg=1.0,
    y_spread_mm=1.5,
    rz_spread_deg=4.0,
)


def test_one_axis_can_be_spread_more_than_the_others(exact: Make) -> None:
    assert APART.spreads == (0.5, 2.0, 1.0, 1.0, 5.0)
    task = Insertion(exact(start=APART), RUN, 0)
    poses = [pose_of(task.home(episode, 0)) for episode in range(300)]
    for axis, half in ((0, 0.5), (1, 2.0), (3, 1.0), (4, 1.0), (5, 5.0)):
        values = [abs(pose[axis]) for pose in poses]
        assert 0.95 * half < max(values) <= half


def test_an_axis_of_its_own_does_not_change_the_others(exact: Make) -> None:
    both, apart = (
        Insertion(exact(start=start), RUN, 0).home(7, 0) for start in (SPREAD, replace(SPREAD, rz_spread_deg=1))
    )
    assert replace(apart, rz_deg=both.rz_deg) == both
    assert apart.rz_deg == 1.5 * both.rz_deg
