"""Bounds of moves that are no listed ones: what is within them, what it counts as, and that every robot makes it."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from services.robot_link.val2 import oat
from services.robot_ur import motion as ur
from services.ros2 import motion as ros2
from services.rules.bounds import Bounds, on_grid
from services.rules.guard import Guard
from services.rules.workspace import Workspace
from services.wire.actions import GRID, INSERT, Increment, increments
from services.wire.definition import Continuous, Definition, Limits, Moves, NamedMove
from services.wire.definition_file import definition_sha256, load
from services.wire.definition_rules import contradiction
from services.wire.errors import DefinitionError
from services.wire.messages import FtPacket, Home, Move

MOST = Continuous(x_mm=0.2, y_mm=0.1, z_mm=0.3, rx_deg=0.15, ry_deg=0.2)
SETTINGS = Definition(name="bounded", moves=Moves(continuous=MOST, insertion_mm=0.3), limits=Limits(hard_force_n=60.0))
BACK = (NamedMove(name="aside", x_mm=0.2), NamedMove(name="in", z_mm=0.2), NamedMove(name="out", z_mm=-0.2))
FELT = FtPacket(sequence=1, t_ns=1, status=0, force_n=((0.0, 0.0, -1.0),), torque_nm=((0.0, 0.0, 0.0),))


@pytest.fixture
def bounds() -> Bounds:
    return Bounds(SETTINGS)


def homed(settings: Definition) -> Guard:
    guard = Guard(settings)
    start = settings.start
    pose = {name: getattr(start, name) for name in ("x_mm", "y_mm", "rx_deg", "ry_deg", "rz_deg")}
    guard.homed(Home(run="test-s0", episode=0, z_mm=-start.height_mm, **pose))
    return guard


def asked(increment: Increment) -> Move:
    return Move(run="test-s0", episode=0, step=1, **increment._asdict())


def test_axes_and_ends(bounds: Bounds) -> None:
    assert bounds.axes == (0, 1, 2, 3, 4)
    assert bounds.within((0.0, 0.0, -1.0, 0.0, 0.0)) == Increment()
    assert bounds.within((0.0, 0.0, 1.0, 0.0, 0.0)) == Increment(dz_mm=0.3)
    assert bounds.within((-1.0, 0.0, -1.0, 0.0, 0.0)) == Increment(dx_mm=-0.2)
    assert bounds.within((0.0, 0.5, 0.0, 0.0, 0.0)) == Increment(dy_mm=0.05, dz_mm=0.15)


@pytest.mark.parametrize("parts", [(0.0,) * 4, (0.0,) * 6, (1.1, 0.0, 0.0, 0.0, 0.0), (float("nan"),) + (0.0,) * 4])
def test_parts_that_are_none_are_refused(bounds: Bounds, parts: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="expected 5 from -1 to 1"):
        bounds.within(parts)


@given(st.lists(st.floats(-1.0, 1.0), min_size=5, max_size=5))
def test_what_is_made_within_bounds_passes_task_and_guard_and_is_on_the_grid(parts: list[float]) -> None:
    bounds = Bounds(SETTINGS)
    increment = bounds.within(parts)
    assert bounds.complaint(increment) is None and bounds.hold(increment)
    assert homed(SETTINGS).moving(asked(increment), FELT, 0.0) is None
    assert on_grid(increment) == increment == Increment(*(round(value, GRID) for value in increment))
    again = bounds.within([min(1.0, max(-1.0, part)) for part in bounds.parts_of(increment)])
    assert again == pytest.approx(increment, abs=2 * 10.0**-GRID)


def test_the_most_of_all_axes_is_shortened_evenly_to_what_a_listed_move_adds(bounds: Bounds) -> None:
    long, listed = bounds.within((1.0,) * 5), bounds._force
    assert long.dx_mm / long.dz_mm == pytest.approx(2 / 3, rel=1e-2)
    assert listed.added_n(long) == pytest.approx(listed.largest_n, rel=1e-2)
    assert bounds.complaint(Increment(*bounds.high)) is not None


@pytest.mark.parametrize(
    ("increment", "words"),
    [
        (Increment(dx_mm=0.2001), "dx_mm: expected -0.2 to 0.2, as moves.continuous says, got 0.2001"),
        (Increment(dz_mm=-0.01), "dz_mm: expected -0 to 0.3"),
        (Increment(rz_deg=0.1), "rz_deg: expected -0 to 0, as"),
        (Increment(dy_mm=float("nan")), "dy_mm: expected -0.1 to 0.1"),
        (Increment(0.2, 0.1, 0.3, 0.15, 0.2), "size: expected at most the "),
    ],
)
def test_what_is_out_of_bounds_is_said(bounds: Bounds, increment: Increment, words: str) -> None:
    complaint = bounds.complaint(increment)
    assert complaint is not None and complaint.startswith(words)


def test_the_guard_refuses_beyond_the_bounds_and_what_adds_more_force_than_a_listed_move() -> None:
    guard = homed(SETTINGS)
    assert guard.moving(asked(Increment(dz_mm=0.31)), FELT, 0.0) == "guard: dz_mm: expected 0.0 to 0.3, got 0.31"
    refused = guard.moving(asked(Increment(0.2, 0.1, 0.3, 0.15, 0.2)), FELT, 0.0)
    assert refused is not None and refused.startswith("guard: size: ")


def test_beside_a_list_the_guard_takes_what_is_listed_or_within_the_bounds() -> None:
    moves = Moves(list=BACK, continuous=Continuous(x_mm=0.1, z_mm=0.1, back_mm=0.05))
    guard = homed(replace(SETTINGS, moves=moves))
    for increment in (*increments(moves), Increment(dx_mm=0.03, dz_mm=0.07), Increment(dz_mm=-0.05)):
        assert guard.moving(asked(increment), FELT, 0.0) is None
    refused = guard.moving(asked(Increment(dz_mm=-0.15)), FELT, 0.0)
    assert refused is not None and refused.startswith("guard: move: expected one of moves.list")


def test_what_a_move_counts_as() -> None:
    moves = Moves(list=BACK, continuous=Continuous(x_mm=0.1, z_mm=0.1, back_mm=0.05))
    bounds = Bounds(replace(SETTINGS, moves=moves))
    names = [BACK[bounds.counts_as(Increment(dz_mm=dz_mm))].name for dz_mm in (-0.0001, 0.0, 0.0499, 0.05, 0.1)]
    assert names == ["out", "aside", "aside", "in", "in"]
    assert Bounds(SETTINGS).counts_as(Increment(dz_mm=0.2)) == INSERT


def test_without_bounds_no_increment_is_taken() -> None:
    bounds = Bounds(Definition(name="plain"))
    assert bounds.axes == () and not bounds.hold(Increment())
    assert bounds.complaint(Increment()) == (
        "expected the number of a move, as moves.continuous has no bounds, got an increment"
    )


def test_default_workspace_and_depth_have_room_for_it() -> None:
    short = replace(SETTINGS, moves=Moves(actions=5, continuous=Continuous(z_mm=0.5, rz_deg=1.0)))
    workspace = Workspace(replace(short, limits=replace(short.limits, move_limit=10)))
    workspace.begin(0.0)
    for _ in range(10):
        assert workspace.complaint(Increment(dz_mm=0.5, rz_deg=1.0)) is None
        workspace.take(Increment(dz_mm=0.5, rz_deg=1.0))
    refused = workspace.complaint(Increment(rz_deg=1.0))
    assert refused is not None and "deg turned" in refused


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("moves.continuous.x_mm=0.1", "moves.continuous.z_mm: expected more than 0 where there are bounds"),
        ("moves.continuous={z_mm=0.1, back_mm=0.1}", "moves.continuous.back_mm: expected 0 without a listed move back"),
        ("moves.continuous.z_mm=3", "moves.continuous.z_mm: expected `float` <= 2"),
        ("moves.continuous.w_mm=3", "moves.continuous.w_mm: unknown key"),
        ("classifier.kind=none", "classifier.kind: expected one that tells states apart with learner.kind ="),
    ],
)
def test_definitions_that_cannot_be_are_refused(override: str, words: str) -> None:
    with pytest.raises(DefinitionError) as error:
        load("chamfered-q-softmax", [override])
    assert words in str(error.value)


def test_bounds_are_part_of_a_definition_only_where_there_are_some() -> None:
    plain = load("suite-round")
    bounded = load("suite-round", ["moves.continuous.z_mm=0.2"])
    assert contradiction(bounded) is None
    assert definition_sha256(plain) != definition_sha256(bounded)
    assert definition_sha256(plain) == definition_sha256(replace(plain, moves=replace(plain.moves)))


def test_all_robots_have_this_grid() -> None:
    assert GRID == ur.GRID == ros2.GRID == oat.GRID


@pytest.mark.parametrize("convention", oat.CONVENTIONS)
def test_a_controller_of_1977_is_told_such_a_move_exactly(convention: oat.Convention) -> None:
    bounds = Bounds(replace(SETTINGS, moves=Moves(continuous=replace(MOST, rz_deg=0.3))))
    for parts in itertools.product((-1.0, -0.37, 0.0, 0.61, 1.0), repeat=6):
        increment = bounds.within(parts)
        assert oat.trans_text(increment, convention).applied == increment
