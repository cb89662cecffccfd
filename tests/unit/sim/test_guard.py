"""The force guard: each limit, on both sides, and the hard force."""

from __future__ import annotations

import math
from typing import Literal

import pytest

from services.sim.guard import Guard
from services.wire.actions import increments
from services.wire.definition import Definition, Limits, Moves
from services.wire.messages import Move

MOVES = Moves(actions=11, lateral_mm=0.1, insertion_mm=0.2, rotation_deg=0.3)
SETTINGS = Definition(name="guarded", moves=MOVES, limits=Limits(hard_force_n=20.0))
BOTH_WAYS = {"dx_mm": 0.1, "dy_mm": 0.1, "rx_deg": 0.3, "ry_deg": 0.3, "rz_deg": 0.3}


def move(**increment: float) -> Move:
    return Move(run="test-s0", episode=0, step=1, **increment)


@pytest.fixture
def guard() -> Guard:
    return Guard(SETTINGS)


@pytest.mark.parametrize("actions", [5, 9, 11])
@pytest.mark.parametrize("force_n", [0.0, 19.0])
def test_every_action_of_the_experiment_passes(actions: Literal[5, 9, 11], force_n: float) -> None:
    settings = Definition(name="guarded", moves=Moves(actions=actions))
    for increment in increments(settings.moves):
        assert Guard(settings).complaint(move(**increment._asdict()), force_n) is None


@pytest.mark.parametrize(("name", "limit"), BOTH_WAYS.items())
@pytest.mark.parametrize("sign", [1, -1])
def test_a_component_passes_up_to_its_limit_and_not_beyond(guard: Guard, name: str, limit: float, sign: int) -> None:
    assert guard.complaint(move(**{name: sign * limit}), 0.0) is None
    complaint = guard.complaint(move(**{name: sign * (limit + 1e-6)}), 0.0)
    assert complaint == f"guard: {name}: expected {-limit} to {limit}, got {sign * (limit + 1e-6)}"


def test_insertion_passes_up_to_its_limit_and_never_backwards(guard: Guard) -> None:
    assert guard.complaint(move(dz_mm=0.2), 0.0) is None
    assert guard.complaint(move(dz_mm=0.0), 0.0) is None
    for value in (0.200001, -0.000001, -0.2, 5.0):
        assert guard.complaint(move(dz_mm=value), 0.0) == f"guard: dz_mm: expected 0.0 to 0.2, got {value}"


def test_rounding_is_no_offence(guard: Guard) -> None:
    assert guard.complaint(move(dx_mm=math.nextafter(0.1, 1)), 0.0) is None
    assert guard.complaint(move(dz_mm=-1e-12), 0.0) is None


@pytest.mark.parametrize(("actions", "forbidden"), [(5, ("rx_deg", "ry_deg", "rz_deg")), (9, ("rz_deg",)), (11, ())])
def test_only_the_turns_of_the_action_set_pass(actions: Literal[5, 9, 11], forbidden: tuple[str, ...]) -> None:
    guard = Guard(Definition(name="guarded", moves=Moves(actions=actions, rotation_deg=0.3)))
    for name in ("rx_deg", "ry_deg", "rz_deg"):
        for sign in (1, -1):
            complaint = guard.complaint(move(**{name: sign * 0.3}), 0.0)
            assert (complaint is not None) == (name in forbidden), name


def test_one_bad_component_among_good_ones_is_found(guard: Guard) -> None:
    complaint = guard.complaint(move(dx_mm=0.1, dy_mm=-0.1, dz_mm=0.2, rx_deg=0.3, ry_deg=0.3, rz_deg=0.31), 0.0)
    assert complaint == "guard: rz_deg: expected -0.3 to 0.3, got 0.31"


@pytest.mark.parametrize("name", ["dx_mm", "dy_mm", "dz_mm", "rx_deg", "ry_deg", "rz_deg"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_never_passes(guard: Guard, name: str, value: float) -> None:
    assert guard.complaint(move(**{name: value}), 0.0) is not None


def test_no_motion_at_all_passes_above_the_hard_force(guard: Guard) -> None:
    for increment in ({}, {"dz_mm": 0.2}, {"dx_mm": -0.1}):
        assert guard.complaint(move(**increment), 20.0) is None
        complaint = guard.complaint(move(**increment), math.nextafter(20.0, 21.0))
        assert complaint is not None
        assert "above the hard limit of 20.0 N; only home is taken" in complaint


def test_a_force_that_is_no_number_never_passes(guard: Guard) -> None:
    assert guard.complaint(move(), math.nan) is not None
