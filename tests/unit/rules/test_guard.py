"""The guard beside the robot: each limit, on both sides."""

from __future__ import annotations

import math
from typing import Literal

import pytest
from msgspec.structs import replace

from services.rules.guard import OLDEST_S, Guard
from services.task.insertion import Insertion
from services.wire.actions import Increment, increments
from services.wire.definition import Definition, Limits, Moves, Noise, Start, Wrist
from services.wire.definition_file import load, shipped
from services.wire.definition_rules import contradiction
from services.wire.force_bound import SETTLING_N, ForceBound
from services.wire.messages import FtPacket, Home, Move

RUN = "test-s0"
MOVES = Moves(actions=11, lateral_mm=0.1, insertion_mm=0.2, rotation_deg=0.3)
SETTINGS = Definition(name="guarded", moves=MOVES, limits=Limits(hard_force_n=30.0))
BOTH_WAYS = {"dx_mm": 0.1, "dy_mm": 0.1, "rx_deg": 0.3, "ry_deg": 0.3, "rz_deg": 0.3}
SPREAD = Start(x_mm=1.0, y_mm=-2.0, height_mm=0.5, rx_deg=0.4, xy_spread_mm=0.5, tilt_spread_deg=0.25)


def move(**increment: float) -> Move:
    return Move(run=RUN, episode=0, step=1, **increment)


def felt(force_n: float = 0.0, status: int = 0) -> FtPacket:
    """Return a sample with a force that has three components."""
    force = (force_n / 3, -force_n * 2 / 3, force_n * 2 / 3)
    return FtPacket(sequence=1, t_ns=1, status=status, force_n=(force,), torque_nm=((0.0, 0.0, 0.0),))


def home(**pose: float) -> Home:
    at = {"x_mm": 1.6, "y_mm": -2.2, "z_mm": -1.0, "rx_deg": 1.8, "ry_deg": 0.4, "rz_deg": 0.0}
    return Home(run=RUN, episode=0, **(at | pose))


def homed(settings: Definition = SETTINGS) -> Guard:
    made = Guard(settings)
    made.homed(home(z_mm=-settings.start.height_mm))
    return made


def complaint(guard: Guard, asked: Move, force_n: float = 0.0) -> str | None:
    return guard.moving(asked, felt(force_n), 0.0)


def go(guard: Guard, **increment: float) -> str | None:
    """Ask for a motion, and make it when the guard lets it pass."""
    found = complaint(guard, move(**increment))
    if found is None:
        guard.moved(Increment(**increment))
    return found


@pytest.fixture
def guard() -> Guard:
    return homed()


# -- steps ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("actions", [5, 9, 11])
@pytest.mark.parametrize("force_n", [0.0, 9.99])
def test_every_action_of_the_experiment_passes(actions: Literal[5, 9, 11], force_n: float) -> None:
    settings = Definition(name="guarded", moves=Moves(actions=actions))
    for increment in increments(settings.moves):
        assert complaint(homed(settings), move(**increment._asdict()), force_n) is None


@pytest.mark.parametrize(("name", "limit"), BOTH_WAYS.items())
@pytest.mark.parametrize("sign", [1, -1])
def test_a_component_passes_up_to_its_limit_and_not_beyond(guard: Guard, name: str, limit: float, sign: int) -> None:
    assert complaint(guard, move(**{name: sign * limit})) is None
    refused = complaint(guard, move(**{name: sign * (limit + 1e-6)}))
    assert refused == f"guard: {name}: expected {-limit} to {limit}, got {sign * (limit + 1e-6)}"


def test_insertion_passes_up_to_its_limit_and_never_backwards(guard: Guard) -> None:
    assert complaint(guard, move(dz_mm=0.2)) is None
    assert complaint(guard, move(dz_mm=0.0)) is None
    for value in (0.200001, -0.000001, -0.2, 5.0):
        assert complaint(guard, move(dz_mm=value)) == f"guard: dz_mm: expected 0.0 to 0.2, got {value}"


def test_rounding_is_no_offence(guard: Guard) -> None:
    assert complaint(guard, move(dx_mm=math.nextafter(0.1, 1))) is None
    assert complaint(guard, move(dz_mm=-1e-12)) is None


@pytest.mark.parametrize(("actions", "forbidden"), [(5, ("rx_deg", "ry_deg", "rz_deg")), (9, ("rz_deg",)), (11, ())])
def test_only_the_turns_of_the_action_set_pass(actions: Literal[5, 9, 11], forbidden: tuple[str, ...]) -> None:
    guard = homed(replace(SETTINGS, moves=replace(MOVES, actions=actions)))
    for name in ("rx_deg", "ry_deg", "rz_deg"):
        for sign in (1, -1):
            assert (complaint(guard, move(**{name: sign * 0.3})) is not None) == (name in forbidden), name


def test_one_bad_component_among_good_ones_is_found(guard: Guard) -> None:
    refused = complaint(guard, move(dx_mm=0.1, dy_mm=-0.1, dz_mm=0.2, rx_deg=0.3, ry_deg=0.3, rz_deg=0.31))
    assert refused == "guard: rz_deg: expected -0.3 to 0.3, got 0.31"


@pytest.mark.parametrize("name", ["dx_mm", "dy_mm", "dz_mm", "rx_deg", "ry_deg", "rz_deg"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_never_passes(guard: Guard, name: str, value: float) -> None:
    assert complaint(guard, move(**{name: value})) is not None


def test_a_motion_of_all_axes_at_once_is_more_than_an_action(guard: Guard) -> None:
    assert complaint(guard, move(dx_mm=0.1, dy_mm=0.1, dz_mm=0.2)) is None
    refused = complaint(guard, move(dx_mm=0.1, rx_deg=0.3, ry_deg=0.3))
    assert refused is not None
    assert refused.startswith("guard: size: expected at most the ")


def test_no_more_motions_than_an_episode_has() -> None:
    guard = homed(replace(SETTINGS, limits=replace(SETTINGS.limits, move_limit=30)))
    assert complaint(guard, replace(move(), step=30)) is None
    refused = complaint(guard, replace(move(), step=31))
    assert refused == "guard: step: expected at most 30 motions since home, got 31; only home is taken"


# -- workspace -----------------------------------------------------------------------------------------------------


def test_only_start_poses_of_the_experiment_are_homes() -> None:
    guard = Guard(Definition(name="guarded", start=SPREAD))
    inside = home(x_mm=1.5, y_mm=-2.5, z_mm=-0.5, rx_deg=0.15, ry_deg=0.25, rz_deg=-0.25)
    assert guard.homing(inside) is None
    far: tuple[tuple[str, float], ...] = (("x_mm", 1.51), ("y_mm", -1.49), ("z_mm", -0.49), ("z_mm", -9.0))
    for name, value in (*far, ("rx_deg", 0.66), ("ry_deg", -0.26), ("rz_deg", 0.26), ("z_mm", math.nan)):
        refused = guard.homing(replace(inside, **{name: value}))
        assert refused is not None, name
        assert refused.startswith(f"guard: {name}: expected ")


@pytest.mark.parametrize("name", shipped())
def test_every_start_of_a_shipped_definition_is_a_home(name: str) -> None:
    definition = load(name)
    task = Insertion(definition, RUN, 3)
    assert [Guard(definition).homing(task.home(episode, 0)) for episode in range(200)] == [None] * 200


def test_no_deeper_than_success_and_one_step_more() -> None:
    """2/3 of 14.7 mm, from 1 mm above the mouth, in steps of 0.2 mm: the task's last is the 54th."""
    guard = homed(Definition(name="guarded"))
    for _ in range(55):
        assert go(guard, dz_mm=0.2) is None
    assert go(guard, dz_mm=0.2) == "guard: depth: expected at most 10.000 mm commanded, got 10.200"
    assert go(guard, dx_mm=0.2) is None
    guard.homed(home())
    assert go(guard, dz_mm=0.2) is None


@pytest.mark.parametrize("name", shipped())
def test_by_default_an_episode_has_room_for_all_its_moves_in_any_direction(name: str) -> None:
    definition = load(name)
    for increment in increments(definition.moves):
        guard, deep = homed(definition), increment.dz_mm > 0.0
        for _ in range(50 if deep else definition.limits.move_limit):
            assert go(guard, **increment._asdict()) is None


def test_a_workspace_of_ones_own_ends_where_it_says() -> None:
    limits = replace(SETTINGS.limits, workspace_mm=1.0, workspace_deg=3.0)
    guard = homed(replace(SETTINGS, limits=limits))
    for _ in range(10):
        assert go(guard, dy_mm=-0.1) is None
    assert go(guard, dy_mm=-0.1) == "guard: workspace: expected at most 1 mm from the start, got 1.100"
    assert go(guard, dx_mm=0.1) is not None
    assert go(guard, dy_mm=0.1) is None
    for _ in range(10):
        assert go(guard, ry_deg=-0.3) is None
    assert go(guard, ry_deg=-0.3) == "guard: workspace: expected at most 3 deg turned, got 3.300"
    assert go(guard, rx_deg=0.3) is not None
    assert go(guard, ry_deg=0.3) is None


def test_a_way_that_cancels_out_component_by_component_still_leads_away() -> None:
    """Forth upright, back tilted: the sums of all components are zero, the tip has come down by sin(tilt)."""
    guard = homed(replace(SETTINGS, limits=replace(SETTINGS.limits, workspace_mm=2.0)))
    there = (*[{"dx_mm": 0.1}] * 15, *[{"ry_deg": 0.3}] * 40)
    refused = None
    for _ in range(30):
        for increment in (*there, *({name: -value for name, value in part.items()} for part in there)):
            refused = refused or go(guard, **increment)
    assert refused is not None
    assert refused.startswith("guard: workspace: expected at most 2 mm from the start")


def test_turning_about_the_flange_takes_the_tip_along() -> None:
    """0.3 degrees about a point 130 mm behind the tip are 0.681 mm: the second would lead beyond 1 mm."""
    limits = replace(SETTINGS.limits, workspace_mm=1.0)
    guard = homed(replace(SETTINGS, moves=replace(MOVES, rotation_centre_mm=130.0), limits=limits))
    assert go(guard, rx_deg=0.3) is None
    assert go(guard, rx_deg=0.3) == "guard: workspace: expected at most 1 mm from the start, got 1.361"
    assert go(guard, rz_deg=0.3) is None
    # In the tool's frame of now: forth and back along Y, which the turn has hardly moved.
    for _ in range(3):
        assert go(guard, dy_mm=-0.1) is None
    assert go(guard, dy_mm=-0.1) is not None


def test_what_was_really_applied_counts() -> None:
    guard = homed(replace(SETTINGS, limits=replace(SETTINGS.limits, workspace_mm=1.0)))
    for _ in range(9):
        guard.moved(Increment(dx_mm=0.11))
    assert complaint(guard, move(dx_mm=0.1)) is not None


# -- sensor --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("age_s", [0.0, 0.05, 0.1])
def test_a_fresh_sample_lets_a_motion_pass(guard: Guard, age_s: float) -> None:
    assert guard.moving(move(dx_mm=0.1), felt(), age_s) is None


@pytest.mark.parametrize("age_s", [math.nextafter(OLDEST_S, 1), 5.0, math.inf, math.nan, -1e-9])
def test_a_stale_sample_stops_every_motion(guard: Guard, age_s: float) -> None:
    for increment in ({}, {"dx_mm": 0.1}, {"dz_mm": 0.2}):
        refused = guard.moving(move(**increment), felt(), age_s)
        assert refused is not None
        assert refused.startswith("guard: sensor: expected an F/T sample of 0 to 0.1 s ago, got one of ")


def test_the_greatest_age_can_be_set() -> None:
    assert Guard(SETTINGS, oldest_s=2.0).moving(move(), felt(), 1.5) is None
    assert Guard(SETTINGS, oldest_s=0.01).moving(move(), felt(), 0.02) is not None


def test_a_sensor_that_falls_silent_stops_the_arm_within_one_step(guard: Guard) -> None:
    """Motions every 20 ms, samples until one of them, time told as numbers."""
    made = []
    for tick in range(40):
        last_sample_s = min(tick, 20) * 0.02
        if guard.moving(move(dx_mm=0.1 if tick % 2 else -0.1), felt(), tick * 0.02 - last_sample_s) is None:
            made.append(tick)
    assert made == list(range(26)), "five motions in the 0.1 s that a sample may be old, none after"
    assert guard.moving(move(), None, 0.0) == "guard: sensor: expected an F/T sample, got none; only home is taken"


@pytest.mark.parametrize(
    ("status", "passes"), [(0, True), (2, True), (1, False), (4, False), (8, False), (16, False), (6, False)]
)
def test_a_sensor_that_says_that_it_is_not_well_stops_the_arm(guard: Guard, status: int, passes: bool) -> None:
    refused = guard.moving(move(), felt(status=status), 0.0)
    assert (refused is None) == passes
    assert passes or (refused is not None and f"got status {status} (" in refused)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_load_that_is_no_number_stops_the_arm(guard: Guard, bad: float) -> None:
    good = felt()
    for name in ("force_n", "torque_nm"):
        refused = guard.moving(move(), replace(good, **{name: ((0.0, bad, 0.0),)}), 0.0)
        assert refused is not None
        assert refused.startswith("guard: sensor: expected a finite force and torque")


def test_home_needs_no_sensor() -> None:
    guard = Guard(Definition(name="guarded"))
    assert guard.sensing(None, 0.0) is not None
    assert guard.homing(home()) is None


# -- force ---------------------------------------------------------------------------------------------------------


def test_after_a_collision_only_home_is_taken(guard: Guard) -> None:
    for increment in ({}, {"dz_mm": 0.2}, {"dx_mm": -0.1}):
        assert complaint(guard, move(**increment), 9.99) is None
        refused = complaint(guard, move(**increment), 10.000001)
        assert refused is not None
        assert refused.startswith("guard: force: expected less than the 10.0 N of a collision, got 10.00 N")
        assert refused.endswith("; only home is taken")


def test_a_motion_that_could_lead_above_the_hard_limit_is_refused() -> None:
    """15 N/mm: 0.2 mm add 3 N, 0.1 mm 1.5 N, and what settles anew half a newton."""
    guard = homed(replace(SETTINGS, limits=Limits(hard_force_n=12.0)))
    assert complaint(guard, move(dz_mm=0.2), 8.49) is None
    refused = complaint(guard, move(dz_mm=0.2), 8.51)
    assert refused == (
        "guard: force: expected at most 12.0 N after the motion, got 8.51 N and 3.50 N that this motion can add"
    )
    assert complaint(guard, move(dx_mm=0.1), 9.9) is None


def test_the_bound_is_that_of_the_spring_at_the_sensor() -> None:
    wrist = Wrist(stiffness_n_per_mm=10.0, stiffness_nm_per_rad=40.0, sensor_height_mm=100.0)
    bound = ForceBound(Definition(name="guarded", wrist=wrist))
    still = bound.added_n(Increment())
    assert still == SETTLING_N
    assert bound.added_n(Increment(dx_mm=0.3, dy_mm=-0.4)) - still == pytest.approx(5.0)
    # 0.5 degrees shift the sensor by 0.873 mm and turn a spring of sqrt(10 N/mm * 40 000 N mm) = 632 N per radian.
    assert bound.added_n(Increment(rx_deg=0.5)) - still == pytest.approx(math.hypot(8.7266, 5.5192), rel=1e-4)
    assert bound.added_n(Increment(rz_deg=0.5)) - still == pytest.approx(5.5192, rel=1e-4)
    # About the sensor's own point, or one as far behind it as the tip is before it.
    for centre_mm, shift_n in ((100.0, 0.0), (200.0, 8.7266)):
        about = Definition(name="guarded", wrist=wrist, moves=Moves(rotation_centre_mm=centre_mm))
        added = ForceBound(about).added_n(Increment(rx_deg=0.5)) - still
        assert added == pytest.approx(math.hypot(shift_n, 5.5192), rel=1e-4)


def test_errors_of_arm_and_sensor_make_the_bound_wider() -> None:
    still = {
        scale: ForceBound(Definition(name="n", noise=Noise(scale=scale, along_mm=0.02, force_n=0.04))).added_n(
            Increment()
        )
        for scale in (0.0, 1.0, 2.0)
    }
    five = 5.0 * math.sqrt((15.0 * 0.02) ** 2 + 2 * 0.04**2)
    assert still == pytest.approx({0.0: SETTLING_N, 1.0: SETTLING_N + five, 2.0: SETTLING_N + 2 * five})


# -- definitions ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", shipped())
def test_no_move_of_a_shipped_definition_is_ever_refused_for_its_force(name: str) -> None:
    definition = load(name)
    guard, last_n = homed(definition), math.nextafter(definition.limits.collision_force_n, 0.0)
    for increment in increments(definition.moves):
        assert guard.moving(move(**increment._asdict()), felt(0.0), 0.0) is None
        assert guard.moving(move(**increment._asdict()), felt(last_n * (1 - 1e-12)), 0.0) is None
    assert ForceBound(definition).needed_n <= definition.limits.hard_force_n


def test_a_definition_that_the_guard_would_stop_is_refused_and_told_the_limit_that_it_needs() -> None:
    definition = load("chamfered-q-softmax")
    assert contradiction(definition) is None
    turning = replace(definition, moves=replace(definition.moves, rotation_deg=0.4))
    found = contradiction(turning)
    assert found is not None
    key, said = found
    assert key == "limits.hard_force_n"
    why = "limits.collision_force_n = 10.0 and what a move can add to it on this wrist"
    assert said == f"expected at least 27.54 for {why}, got 20.0"
    assert contradiction(replace(turning, limits=replace(turning.limits, hard_force_n=27.54))) is None


def test_a_depth_that_no_episode_could_succeed_in_is_refused() -> None:
    definition = load("chamfered-q-softmax")
    found = contradiction(replace(definition, limits=replace(definition.limits, deepest_mm=9.9)))
    assert found == ("limits.deepest_mm", "expected 0, or at least 10.000 for an episode to succeed, got 9.9")
    assert contradiction(replace(definition, limits=replace(definition.limits, deepest_mm=10.0))) is None
