"""The simulated cell: same motions, same answers; whatever is refused moves nothing."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace

from experiments.lab.remembered_world import RememberedWorld
from services.rules.motions import GuardError, OtherRunError, OutOfOrderError
from services.sim.cell import MOTION_NS, SimulatedCell
from services.sim.pose import Pose
from services.sim.world import Reading, World
from services.wire.actions import Increment, increments
from services.wire.codec import encode
from services.wire.definition import Contact, Definition, Limits, Moves, Noise, Parts, Sensor, Start
from services.wire.definition_file import load
from services.wire.definition_rules import contradiction
from services.wire.definition_world import Change, Hole
from services.wire.errors import RefusedError
from services.wire.messages import FtPacket, Home, Move, Moved
from services.wire.randomness import Role, generator

RUN = "test-s0"
SETTINGS = Definition(
    name="cell",
    parts=Parts(chamfer_mm=0.0),
    start=Start(x_mm=4.0, y_mm=-1.0, height_mm=0.3, rx_deg=0.5, ry_deg=0.2),
)
"""Beside a hole without a chamfer: two moves down the peg stands on the rim."""
FREE = replace(SETTINGS, start=Start(height_mm=15.0))
"""High above everything: nothing to feel."""
HARD = replace(SETTINGS, limits=Limits(collision_force_n=2.0, hard_force_n=20.0))
Answer = tuple[Moved, FtPacket]


def home(episode: int = 0, settings: Definition = SETTINGS) -> Home:
    start = settings.start
    return Home(
        run=RUN,
        episode=episode,
        x_mm=start.x_mm,
        y_mm=start.y_mm,
        z_mm=-start.height_mm,
        rx_deg=start.rx_deg,
        ry_deg=start.ry_deg,
        rz_deg=start.rz_deg,
    )


def down(step: int, episode: int = 0) -> Move:
    return Move(run=RUN, episode=episode, step=step, dz_mm=0.2)


def motions(count: int, episode: int = 0) -> list[Move]:
    """Return made-up motions of all kinds, mostly downwards."""
    kinds = increments(Moves())
    picks = np.random.default_rng(episode).choice([4, 4, 0, 1, 2, 3, 4, 5, 6, 7, 8], size=count)
    return [
        Move(run=RUN, episode=episode, step=number + 1, **kinds[pick]._asdict())
        for number, pick in enumerate(picks.tolist())
    ]


def cell(settings: Definition = SETTINGS, seed: int = 0) -> SimulatedCell:
    return SimulatedCell(settings, RUN, seed)


def made(robot: SimulatedCell, count: int, episode: int = 0, settings: Definition = SETTINGS) -> list[bytes]:
    """Make an episode's motions and return the answers bit by bit."""
    answers = [robot.home(home(episode, settings)), *(robot.move(move) for move in motions(count, episode))]
    return [encode(part) for answer in answers for part in answer]


def bits(answer: Answer) -> tuple[bytes, bytes]:
    return encode(answer[0]), encode(answer[1])


def force_of(answer: Answer) -> float:
    return math.hypot(*answer[1].force_n[-1])


@pytest.fixture(scope="module")
def robot() -> SimulatedCell:
    """One cell for the tests that begin with ``home``; building one takes a moment."""
    return cell()


def refused(robot: SimulatedCell, act: Callable[[], object], error: type[RefusedError], reason: str) -> None:
    """Check that a motion is refused with its reason and that nothing moved."""
    flange, peg = robot.world.flange, robot.world.peg
    with pytest.raises(error) as caught:
        act()
    assert caught.value.reason == reason
    assert (robot.world.flange, robot.world.peg) == (flange, peg)


# -- motions -------------------------------------------------------------------------------------------------------


def test_a_motion_is_answered_with_what_was_applied(robot: SimulatedCell) -> None:
    moved, packet = robot.home(home(episode=3))
    assert (moved.run, moved.episode, moved.step) == (RUN, 3, 0)
    assert (moved.dx_mm, moved.dy_mm, moved.dz_mm, moved.rx_deg, moved.ry_deg, moved.rz_deg) == (0.0,) * 6
    assert len(packet.force_n) == len(packet.torque_nm) == 1
    assert (packet.status, packet.period_ns) == (0, 0)
    for step, increment in enumerate(increments(Moves()), start=1):
        moved, packet = robot.move(Move(run=RUN, episode=3, step=step, **increment._asdict()))
        assert (moved.run, moved.episode, moved.step) == (RUN, 3, step)
        assert (moved.dx_mm, moved.dy_mm, moved.dz_mm, moved.rx_deg, moved.ry_deg, moved.rz_deg) == increment
        assert packet.t_ns >= moved.arrived_t_ns


def test_standing_on_the_rim_is_felt(robot: SimulatedCell) -> None:
    assert force_of(robot.home(home())) == 0.0
    forces = [force_of(robot.move(down(step))) for step in range(1, 5)]
    assert forces[-1] > 1.0
    assert forces == sorted(forces)


def test_the_last_motion_again_is_answered_again_and_not_made_again(robot: SimulatedCell) -> None:
    robot.home(home())
    for move in motions(12):
        answer = robot.move(move)
        flange, peg = robot.world.flange, robot.world.peg
        for _ in range(2):
            assert bits(robot.move(move)) == bits(answer)
        assert (robot.world.flange, robot.world.peg) == (flange, peg)


def test_asking_twice_changes_nothing_that_follows(robot: SimulatedCell) -> None:
    once = made(robot, 10)
    robot.home(home())
    twice = [bits(robot.home(home()))]
    for move in motions(10):
        robot.move(move)
        twice.append(bits(robot.move(move)))
    assert [part for answer in twice for part in answer] == once


def test_before_home_nothing_moves() -> None:
    with pytest.raises(OutOfOrderError, match="the robot is not homed"):
        cell().move(down(1))


@pytest.mark.parametrize(("step", "episode"), [(1, 5), (2, 5), (5, 5), (4, 6), (1, 6), (4, 4), (2**62, 5)])
def test_a_motion_out_of_order_is_refused(robot: SimulatedCell, step: int, episode: int) -> None:
    robot.home(home(episode=5))
    for number in (1, 2, 3):
        last = robot.move(down(number, episode=5))
    refused(robot, lambda: robot.move(down(step, episode)), OutOfOrderError, "out_of_order")
    assert bits(robot.move(down(3, episode=5))) == bits(last)
    assert robot.move(down(4, episode=5))[0].step == 4


def test_the_last_step_with_another_increment_is_refused(robot: SimulatedCell) -> None:
    robot.home(home())
    robot.move(down(1))
    other = Move(run=RUN, episode=0, step=1, dx_mm=0.2)
    refused(robot, lambda: robot.move(other), OutOfOrderError, "out_of_order")


def test_home_is_taken_at_any_time(robot: SimulatedCell) -> None:
    fresh = bits(robot.home(home(episode=9)))
    for count in (0, 1, 6):
        robot.home(home(episode=2))
        for move in motions(count, episode=2):
            robot.move(move)
        assert bits(robot.home(home(episode=9))) == fresh
    assert robot.home(home(episode=1))[0].episode == 1, "an earlier episode, too"


def test_another_run_is_refused(robot: SimulatedCell) -> None:
    robot.home(home())
    robot.move(down(1))
    refused(robot, lambda: robot.move(replace(down(2), run="other-s0")), OtherRunError, "foreign_run")
    refused(robot, lambda: robot.home(replace(home(), run="other-s0")), OtherRunError, "foreign_run")
    assert robot.move(down(2))[0].step == 2


# -- the guard -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "increment", [{"dz_mm": -0.2}, {"dz_mm": 0.3}, {"dx_mm": 0.3}, {"dy_mm": -0.3}, {"rx_deg": 0.3}, {"rz_deg": 0.1}]
)
def test_a_motion_beyond_the_limits_is_refused_and_the_next_good_one_made(
    robot: SimulatedCell, increment: dict[str, float]
) -> None:
    robot.home(home())
    robot.move(down(1))
    bad = Move(run=RUN, episode=0, step=2, **increment)
    for _ in range(2):
        refused(robot, lambda: robot.move(bad), GuardError, "guard")
    assert robot.move(down(2))[0].step == 2


def test_after_a_collision_only_home_is_taken() -> None:
    robot = cell(HARD)
    answer = robot.home(home())
    step = 0
    while force_of(answer) < 2.0:
        step += 1
        assert step < 10
        last = down(step)
        answer = robot.move(last)
    following = Move(run=RUN, episode=0, step=step + 1)
    refused(robot, lambda: robot.move(following), GuardError, "guard")
    refused(robot, lambda: robot.move(down(step + 1)), GuardError, "guard")
    assert bits(robot.move(last)) == bits(answer), "the last motion is still answered again"
    robot.home(home(episode=1))
    assert robot.move(down(1, episode=1))[0].step == 1


def test_a_start_pose_of_no_episode_is_refused_and_the_robot_keeps_its_place(robot: SimulatedCell) -> None:
    robot.home(home())
    robot.move(down(1))
    for wild in (replace(home(), z_mm=5.0), replace(home(), x_mm=1.0), replace(home(), rz_deg=1.0)):
        refused(robot, lambda wild=wild: robot.home(wild), GuardError, "guard")  # type: ignore[misc]
    assert robot.move(down(2))[0].step == 2


class _FailingWorld(World):
    """A world whose sensor stops giving numbers at a move."""

    def __init__(self, definition: Definition, good_moves: int) -> None:
        super().__init__(definition)
        self.left = good_moves

    def move(self, increment: Increment) -> Reading:
        reading = super().move(increment)
        self.left -= 1
        return reading if self.left >= 0 else Reading((0.0, math.nan, 0.0), reading.torque_nm)


def test_a_load_that_is_no_number_stops_motion_within_one_step() -> None:
    world = _FailingWorld(SETTINGS, good_moves=3)
    robot = SimulatedCell(SETTINGS, RUN, 0, world)
    robot.home(home())
    for step in (1, 2, 3):
        robot.move(down(step))
    with pytest.raises(GuardError, match="sensor: expected a finite force"):
        robot.move(down(4))
    at = world.flange
    for lost in (down(4), down(5), Move(run=RUN, episode=0, step=5)):
        refused(robot, lambda lost=lost: robot.move(lost), GuardError, "guard")  # type: ignore[misc]
    assert world.flange == at
    world.left = 3
    robot.home(home(episode=1))
    assert robot.move(down(1, episode=1))[0].step == 1


# -- sameness ------------------------------------------------------------------------------------------------------


def test_a_cell_brought_back_feels_the_same_bit_for_bit(robot: SimulatedCell) -> None:
    expected = made(robot, 15, episode=2)
    assert made(cell(), 15, episode=2) == expected
    made(robot, 7, episode=4)
    assert made(robot, 15, episode=2) == expected
    assert len(set(expected)) > 10


def test_time_and_number_are_a_function_of_episode_and_step(robot: SimulatedCell) -> None:
    stamps = {}
    for episode in (0, 1, 7):
        answers = [robot.home(home(episode)), *(robot.move(move) for move in motions(4, episode))]
        for step, (moved, packet) in enumerate(answers):
            assert packet.t_ns == moved.arrived_t_ns == packet.sequence * MOTION_NS
            stamps[episode, step] = packet.sequence
    assert list(stamps.values()) == sorted(set(stamps.values()))
    _, packet = cell(seed=3).home(home(episode=7))
    assert packet.sequence == stamps[7, 0]


def test_the_longest_episode_does_not_run_into_the_next() -> None:
    """A limit on moves is at most 100 000 (``Limits.move_limit``)."""
    robot = cell(FREE)
    first = robot.home(home(0, FREE))[1].sequence
    following = robot.home(home(1, FREE))[1].sequence
    assert following - first > 100_000


# -- noise ---------------------------------------------------------------------------------------------------------


def noisy(settings: Definition, force_n: float = 0.0, torque_nm: float = 0.0) -> Definition:
    return replace(settings, noise=Noise(force_n=force_n, torque_nm=torque_nm))


def test_without_noise_the_answer_is_what_the_world_reads(robot: SimulatedCell) -> None:
    witness = cell()
    robot.home(home())
    witness.home(home())
    for move in motions(8):
        _, packet = robot.move(move)
        increment = Increment(move.dx_mm, move.dy_mm, move.dz_mm, move.rx_deg, move.ry_deg, move.rz_deg)
        reading = witness.world.move(increment)
        assert packet.force_n == (reading.force_n,)
        assert packet.torque_nm == (reading.torque_nm,)


def test_noise_is_what_is_drawn_for_seed_episode_and_step() -> None:
    robot = cell(noisy(FREE, force_n=0.5, torque_nm=0.25), seed=6)
    for episode in (0, 3):
        answers = [robot.home(home(episode, FREE)), *(robot.move(down(step, episode)) for step in (1, 2, 3))]
        for step, (_, packet) in enumerate(answers):
            draw = generator(6, Role.SENSOR_NOISE, episode, step).standard_normal(6).tolist()
            assert packet.force_n == (tuple(0.5 * value for value in draw[:3]),)
            assert packet.torque_nm == (tuple(0.25 * value for value in draw[3:]),)


def test_noise_adds_to_what_the_world_reads() -> None:
    quiet, loud = cell(), cell(noisy(SETTINGS, force_n=0.5), seed=6)
    quiet.home(home())
    loud.home(home())
    for move in motions(6):
        (_, clean), (_, packet) = quiet.move(move), loud.move(move)
        draw = generator(6, Role.SENSOR_NOISE, 0, move.step).standard_normal(6).tolist()
        assert packet.force_n[0] == tuple(value + 0.5 * z for value, z in zip(clean.force_n[0], draw[:3], strict=True))
        assert packet.torque_nm == clean.torque_nm


def test_one_key_scales_all_noise_or_switches_it_off() -> None:
    noise = Noise(force_n=0.5, torque_nm=0.25, along_mm=0.05, across_mm=0.05, turn_deg=0.1)
    off = cell(replace(SETTINGS, noise=replace(noise, scale=0.0)), seed=6)
    assert made(off, 8) == made(cell(), 8)
    loud = replace(FREE, noise=replace(noise, scale=2.0))
    double = cell(noisy(FREE, force_n=1.0, torque_nm=0.5), seed=6)
    assert bits(cell(loud, seed=6).home(home(0, FREE))) == bits(double.home(home(0, FREE)))


def test_noise_does_not_depend_on_what_happened_before() -> None:
    settings = noisy(FREE, force_n=0.5, torque_nm=0.25)
    one, other = cell(settings, seed=1), cell(settings, seed=1)
    made(one, 5, episode=8, settings=FREE)
    assert made(one, 5, episode=2, settings=FREE) == made(other, 5, episode=2, settings=FREE)
    assert made(cell(settings, seed=2), 5, episode=2, settings=FREE) != made(other, 5, episode=2, settings=FREE)


def test_noise_has_the_size_asked_for() -> None:
    robot = cell(noisy(FREE, force_n=0.5, torque_nm=0.125))
    packets = [robot.home(home(episode, FREE))[1] for episode in range(300)]
    forces = np.array([packet.force_n[0] for packet in packets])
    torques = np.array([packet.torque_nm[0] for packet in packets])
    assert np.allclose(forces.std(axis=0), 0.5, rtol=0.15)
    assert np.allclose(torques.std(axis=0), 0.125, rtol=0.15)
    assert np.allclose(forces.mean(axis=0), 0.0, atol=0.1)


def test_the_shipped_noise_gives_the_greatest_errors_that_the_thesis_saw() -> None:
    """Thesis 5.3: within 0.15 N and 0.012 N m over a minute, here 6000 readings (docs/decisions/0006)."""
    noise = load("chamfered-q-softmax").noise
    robot = cell(noisy(FREE, noise.force_n, noise.torque_nm), seed=2)
    packets = [robot.home(home(episode, FREE))[1] for episode in range(6000)]
    # With 5 N hanging along Z, the length of the force is off by what its Z component is off.
    assert max(abs(packet.force_n[0][2]) for packet in packets) == pytest.approx(0.15, abs=0.02)
    assert max(math.hypot(*packet.torque_nm[0]) for packet in packets) == pytest.approx(0.012, abs=0.0015)


def test_a_sensor_read_in_counts_gives_the_nearest_whole_counts() -> None:
    exact = SimulatedCell(SETTINGS, RUN, 3)
    counted = SimulatedCell(replace(SETTINGS, sensor=Sensor(full_scale_n=200, full_scale_dnm=120)), RUN, 3)
    exact.home(home())
    counted.home(home())
    for step in range(1, 5):
        fine, coarse = exact.move(down(step))[1], counted.move(down(step))[1]
        for one, other in zip(fine.force_n[0], coarse.force_n[0], strict=True):
            assert abs(one - other) <= 100 / 16384
            assert other == round(other * 16384 / 200) * 200 / 16384
        for one, other in zip(fine.torque_nm[0], coarse.torque_nm[0], strict=True):
            assert abs(one - other) <= 6 / 16384
        assert coarse.status == 0
    assert max(map(abs, coarse.force_n[0])) > 1.0


def test_a_saturated_sensor_says_so_and_nothing_moves_on() -> None:
    class Pressed(World):
        """Feels more than a receiver can show."""

        def move(self, increment: Increment) -> Reading:
            return Reading((0.0, 0.0, -500.0), super().move(increment).torque_nm)

    settings = replace(SETTINGS, sensor=Sensor(full_scale_n=200, full_scale_dnm=120))
    cell = SimulatedCell(settings, RUN, 3, world=Pressed(settings))
    cell.home(home())
    with pytest.raises(GuardError, match="saturated"):
        cell.move(down(1))


# -- a hole that is tilted, parts that change ----------------------------------------------------------------------


def test_a_tilted_hole_is_a_start_that_is_tilted_the_other_way() -> None:
    """What is felt in a hole tilted by 2 degrees about X is what is felt in an upright one from the turned start."""
    tilt = math.radians(2.0)
    straight = replace(FREE, start=Start(x_mm=0.3, y_mm=4.0, height_mm=0.5, rx_deg=1.0, ry_deg=0.0))
    tilted = cell(replace(straight, hole=Hole(rx_deg=2.0)))
    upright = World(straight)
    tilted.home(home(settings=straight))
    y = 4.0 * math.cos(tilt) - 0.5 * math.sin(tilt)
    z = -4.0 * math.sin(tilt) - 0.5 * math.cos(tilt)
    upright.home(Pose.from_tilt(0.3, y, z, -1.0, 0.0, 0.0))
    felt = []
    for step in range(1, 7):
        packet, reading = tilted.move(down(step))[1], upright.move(Increment(dz_mm=0.2))
        assert packet.force_n[-1] == pytest.approx(reading.force_n, abs=0.03)
        felt.append(math.hypot(*reading.force_n))
    assert max(felt) > 1.0


def test_a_cell_turns_about_the_centre_that_the_definition_says() -> None:
    robot = cell(replace(FREE, moves=Moves(rotation_centre_mm=130.0)))
    robot.home(home(settings=FREE))
    before = robot.world.flange
    robot.move(Move(run=RUN, episode=0, step=1, rx_deg=0.2))
    assert robot.world.flange.point(-130.0) == pytest.approx(before.point(-130.0))
    assert math.dist(robot.world.flange.position, before.position) == pytest.approx(0.4538, abs=1e-3)


WEARING = replace(
    SETTINGS,
    changes=(
        Change(episode=2, key="contact.friction", value=0.0),
        Change(episode=2, key="parts.chamfer_mm", value=2.0),
        Change(episode=4, key="contact.friction", value=0.8),
    ),
)


def test_parts_change_at_the_beginning_of_an_episode() -> None:
    robot = cell(WEARING)
    for episode, (friction, chamfer) in enumerate([(0.3, 0.0)] * 2 + [(0.0, 2.0)] * 2 + [(0.8, 2.0)] * 2):
        plain = replace(SETTINGS, contact=Contact(friction=friction), parts=replace(SETTINGS.parts, chamfer_mm=chamfer))
        assert made(robot, 7, episode) == made(cell(plain), 7, episode)


def test_changed_parts_are_a_function_of_the_episode_alone() -> None:
    """A simulator that begins in the middle of a run, or goes back, feels what the one from the beginning feels."""
    through = cell(WEARING)
    whole = [made(through, 8, episode) for episode in range(5)]
    for episode in (4, 1, 3, 0, 2):
        assert made(cell(WEARING), 8, episode) == whole[episode]
        assert made(through, 8, episode) == whole[episode]


def test_a_world_that_remembers_forgets_other_parts() -> None:
    remembering, plain = SimulatedCell(WEARING, RUN, 0, RememberedWorld(WEARING)), cell(WEARING)
    for episode in (0, 1, 2, 2, 4, 0):
        assert made(remembering, 8, episode) == made(plain, 8, episode)


# -- a window of samples -------------------------------------------------------------------------------------------


def windowed(settings: Definition, samples: int) -> Definition:
    return replace(settings, sensor=replace(settings.sensor, window=samples))


def test_a_window_has_the_noise_of_that_many_samples() -> None:
    settings = windowed(noisy(FREE, force_n=0.5, torque_nm=0.25), 5)
    robot = cell(settings, seed=6)
    for episode in (0, 3):
        answers = [robot.home(home(episode, FREE)), *(robot.move(down(step, episode)) for step in (1, 2))]
        for step, (moved, packet) in enumerate(answers):
            draw = generator(6, Role.SENSOR_NOISE, episode, step).standard_normal((5, 6))
            assert np.array_equal(np.array(packet.force_n), 0.5 * draw[:, :3])
            assert np.array_equal(np.array(packet.torque_nm), 0.25 * draw[:, 3:])
            assert packet.t_ns == moved.arrived_t_ns
            assert packet.period_ns == 0


def test_samples_of_windows_are_numbered_without_gaps_within_an_episode() -> None:
    robot = cell(windowed(FREE, 7))
    packets = [robot.home(home(2, FREE))[1], *(robot.move(down(step, 2))[1] for step in (1, 2, 3))]
    assert {len(packet.force_n) for packet in packets} == {7}
    assert {after.sequence - before.sequence for before, after in pairwise(packets)} == {7}


def test_a_window_of_a_sensor_read_in_counts_is_of_counts() -> None:
    counted = noisy(replace(FREE, sensor=Sensor(full_scale_n=200, full_scale_dnm=120, window=3)), force_n=0.5)
    _, packet = cell(counted).home(home(0, FREE))
    assert len(set(packet.force_n)) == 3
    for force in packet.force_n:
        for value in force:
            assert value == round(value * 16384 / 200) * 200 / 16384


def test_the_guard_goes_by_the_mean_of_a_window() -> None:
    """Single samples far above the force of a collision, a mean near nothing."""
    settings = windowed(noisy(FREE, force_n=5.0), 400)
    settings = replace(settings, limits=Limits(collision_force_n=4.0, hard_force_n=20.0))
    robot = cell(settings)
    _, packet = robot.home(home(0, FREE))
    assert math.hypot(*packet.force_n[-1]) > 4.0
    for step in range(1, 20):
        robot.move(down(step))


def test_a_longer_window_lets_a_lower_hard_limit_do() -> None:
    rough = replace(SETTINGS, noise=Noise(force_n=1.0))
    assert contradiction(rough) is not None
    assert contradiction(windowed(rough, 64)) is None
