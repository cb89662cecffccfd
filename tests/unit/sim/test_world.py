"""The contact world: forces of the right size and sign, repeatable to the bit, whoever asks and whatever was before."""

from __future__ import annotations

import math
import random
import subprocess
import sys

import pytest
from msgspec.structs import replace

from services.sim.geometry import ROUND_SIDES, geometry_of, peg_vertices
from services.sim.pose import Pose, Vector, conjugate, rotate
from services.sim.world import NO_LOAD, Reading, World
from services.wire.actions import Increment
from services.wire.definition import Contact, Definition, Parts, Wrist

START = Pose.from_tilt(1.6, -2.2, -1.0, 1.8, 0.4, 0.0)
DOWN = Increment(dz_mm=0.2)
UP = Increment(dz_mm=-0.2)
FACET_DEG = 360.0 / ROUND_SIDES
ACTIONS = [
    DOWN,
    *(Increment(**{axis: sign * 0.2}) for axis in ("dx_mm", "dy_mm", "rx_deg", "ry_deg", "rz_deg") for sign in (1, -1)),
]
DEFAULT = Definition(name="default", parts=Parts(clearance_mm=0.25))
SQUARE = Definition(name="square", parts=Parts(shape="square", clearance_mm=0.1, peg_height_mm=13.3))
RECTANGLE = Definition(name="rectangle", parts=Parts(shape="rectangle", peg_breadth_mm=14.0, clearance_mm=0.1))
TRIANGLE = Definition(name="triangle", parts=Parts(shape="triangle", clearance_mm=0.1))
CHAMFERLESS = Definition(name="chamferless", parts=Parts(chamfer_mm=0.0))
RUBBER = Definition(name="rubber", contact=Contact(friction=0.8, stiffness_n_per_mm=10.0))


def size(vector: Vector) -> float:
    return math.hypot(*vector)


def drive(world: World, pose: Pose, moves: list[Increment]) -> list[Reading]:
    return [world.home(pose), *(world.move(increment) for increment in moves)]


def wander(world: World, start: Pose, seed: int, moves: int = 60) -> list[Reading]:
    """Down while free, random moves while in contact, back up when pressed hard; the readings."""
    source = random.Random(seed)
    readings = [world.home(start)]
    for _ in range(moves):
        force = size(readings[-1].force_n)
        increment = DOWN if force < 0.3 else UP if force > 5.0 else source.choice(ACTIONS)
        readings.append(world.move(increment))
    return readings


def bits(readings: list[Reading]) -> list[str]:
    numbers = (n for reading in readings for n in (*reading.force_n, *reading.torque_nm))
    return [number.hex() for number in numbers]


def press(world: World, start: Pose, moves: int) -> Reading:
    return drive(world, start, [DOWN] * moves)[-1]


@pytest.mark.parametrize(
    "definition", [DEFAULT, SQUARE, RECTANGLE, TRIANGLE, CHAMFERLESS, RUBBER], ids=lambda d: d.name
)
def test_a_straight_peg_goes_in_without_any_force(definition: Definition) -> None:
    world = World(definition)
    readings = drive(world, Pose(0.0, 0.0, -1.0), [DOWN] * 78)
    assert readings == [NO_LOAD] * 79
    assert world.peg == world.flange
    assert world.peg.z_mm == pytest.approx(14.6)
    assert world.contact_state() == "free"


@pytest.mark.parametrize("definition", [DEFAULT, SQUARE, RECTANGLE, TRIANGLE, CHAMFERLESS], ids=lambda d: d.name)
def test_pressing_on_the_flat_top_compresses_the_spring(definition: Definition) -> None:
    world = World(definition)
    beside = Pose(0.0, 45.0, -0.05)
    assert world.home(beside) == NO_LOAD
    world.move(DOWN)
    last = 0.0
    for pressed in (0.35, 0.55, 0.75):
        reading = world.move(DOWN)
        stiffness = definition.wrist.stiffness_n_per_mm
        # Flat on flat is what the physics likes least: some rocking, a few percent across.
        assert reading.force_n == pytest.approx((0.0, 0.0, -stiffness * pressed), abs=0.05 * stiffness * pressed)
        assert size(reading.torque_nm) < 0.005 * stiffness * pressed
        assert world.peg.z_mm == pytest.approx(0.0, abs=0.003)
        assert size(reading.force_n) > last
        last = size(reading.force_n)
    assert "top" in world.contact_state()


def test_force_on_a_stiffer_wrist_is_greater_for_the_same_move() -> None:
    soft = World(Definition(name="soft", wrist=Wrist(stiffness_n_per_mm=5.0)))
    stiff = World(Definition(name="stiff", wrist=Wrist(stiffness_n_per_mm=50.0)))
    beside = Pose(0.0, 45.0, -0.05)
    assert press(soft, beside, 2).force_n[2] == pytest.approx(-5.0 * 0.35, abs=0.02)
    assert press(stiff, beside, 2).force_n[2] == pytest.approx(-50.0 * 0.35, abs=0.1)


@pytest.mark.parametrize("height_m", [0.0, 0.03, 0.12])
def test_torque_is_lever_times_force(height_m: float) -> None:
    wrist = Wrist(sensor_height_mm=1000.0 * height_m)
    slippery = Definition(name="slippery", parts=DEFAULT.parts, contact=Contact(friction=0.0), wrist=wrist)
    world = World(slippery)
    reading = press(world, Pose.from_tilt(1.0, 0.0, 0.9, 0.0, -1.8, 0.0), 6)
    force, torque = reading.force_n, reading.torque_nm
    assert force[0] < -0.3
    assert force[2] < -0.3
    # Without friction a 45 degree face pushes as much across as along, give or take the tilt of the tool frame.
    assert force[0] / force[2] == pytest.approx(1.0, abs=0.1)
    assert abs(force[1]) < 0.05
    # The contact is at the tip's edge, (+12.4, 0) mm, as far below the sensor as that is above the tip: T = r x F.
    assert torque[1] == pytest.approx(height_m * force[0] - 0.0124 * force[2], abs=0.002)
    assert world.contact_state() == "chamfer-0"


def test_tilted_and_off_centre_the_force_points_back_to_the_centre() -> None:
    world = World(DEFAULT)
    for x, y in ((1.0, 0.0), (0.0, -1.0), (-0.7, 0.7)):
        reading = world.home(Pose.from_tilt(x, y, 0.9, 1.8, 0.4, 0.0))
        while size(reading.force_n) < 0.3:
            assert world.flange.z_mm < 3.0, "no contact with the chamfer"
            reading = world.move(DOWN)
        assert reading.force_n[0] * x + reading.force_n[1] * y < -0.1
        assert world.contact_state().startswith("chamfer")


def assert_same_force(force: Vector, expected: Vector) -> None:
    """Equal in size to 6 %, as far as friction lets it settle, in direction to the facets that stand for circles."""
    assert size(expected) > 0.5
    assert size(force) == pytest.approx(size(expected), rel=0.06, abs=0.02)
    assert force[2] == pytest.approx(expected[2], abs=0.06 * size(expected))
    angle = math.atan2(force[1], force[0]) - math.atan2(expected[1], expected[0])
    assert abs(math.degrees(math.remainder(angle, 2.0 * math.pi))) < 1.5 * FACET_DEG


@pytest.mark.parametrize("definition", [DEFAULT, SQUARE], ids=lambda d: d.name)
@pytest.mark.parametrize("moves", [5, 6, 7])
def test_mirrored_starts_give_mirrored_forces(definition: Definition, moves: int) -> None:
    world = World(definition)
    x, y, z = press(world, Pose.from_tilt(1.0, -1.4, 0.9, 1.0, 0.6, 0.0), moves).force_n
    # The mirror x -> -x keeps rotation about X and turns rotation about Y round.
    other = press(world, Pose.from_tilt(-1.0, -1.4, 0.9, 1.0, -0.6, 0.0), moves)
    assert_same_force(other.force_n, (-x, y, z))


@pytest.mark.parametrize("definition", [DEFAULT, SQUARE], ids=lambda d: d.name)
def test_a_start_turned_by_90_degrees_turns_the_force(definition: Definition) -> None:
    world = World(definition)
    x, y, z = press(world, Pose.from_tilt(1.0, -1.4, 0.9), 7).force_n
    other = press(world, Pose.from_tilt(1.4, 1.0, 0.9), 7)
    assert_same_force(other.force_n, (-y, x, z))


def test_pushing_on_and_on_collides() -> None:
    sizes = [size(reading.force_n) for reading in drive(World(DEFAULT), START, [DOWN] * 25)]
    assert sizes[0] == 0.0
    assert max(sizes) >= 10.0


@pytest.mark.parametrize(
    "definition", [DEFAULT, SQUARE, RECTANGLE, TRIANGLE, CHAMFERLESS, RUBBER], ids=lambda d: d.name
)
def test_a_resting_reading_stays_put(definition: Definition) -> None:
    world = World(definition)
    changes: list[float] = []
    source = random.Random(5)
    reading = world.home(START)
    for _ in range(120):
        force = size(reading.force_n)
        reading = world.move(DOWN if force < 0.3 else UP if force > 5.0 else source.choice(ACTIONS))
        if size(reading.force_n) > 0.1:
            again = world.move(Increment())
            changes.append(math.dist(reading.force_n, again.force_n))
    changes.sort()
    assert len(changes) > 50
    # Now and then the solver finds another of the resting states that friction allows.
    assert changes[int(0.8 * len(changes))] < 0.01


def guide(world: World) -> tuple[int, float, bool]:
    """From the usual start: step down while free, else go where the force points, straighten when in; by hand."""
    reading, sideways, greatest = world.home(START), 0, 0.0
    for _ in range(150):
        fx, fy, _ = reading.force_n
        if size(reading.force_n) < 0.3:
            increment = DOWN
        elif abs(fx) > abs(fy):
            increment, sideways = Increment(dx_mm=math.copysign(0.2, fx)), sideways + 1
        else:
            increment, sideways = Increment(dy_mm=math.copysign(0.2, fy)), sideways + 1
        reading = world.move(increment)
        greatest = max(greatest, size(reading.force_n))
        if world.peg.z_mm >= 7.0:
            return sideways, greatest, True
    return sideways, greatest, False


def test_following_the_force_finds_the_hole_gently() -> None:
    sideways, greatest, found = guide(World(DEFAULT))
    assert found
    assert 10 <= sideways <= 30
    assert greatest < 4.0


@pytest.mark.parametrize(
    "definition", [DEFAULT, SQUARE, RECTANGLE, TRIANGLE, CHAMFERLESS, RUBBER], ids=lambda d: d.name
)
def test_an_episode_depends_on_nothing_before_it(definition: Definition) -> None:
    first = bits(wander(World(definition), START, 1))
    used = World(definition)
    neighbour = World(SQUARE)
    for seed in range(2, 6):
        wander(used, START._replace(x_mm=0.1 * seed), seed)
        wander(neighbour, START, seed, 20)
    assert bits(wander(used, START, 1)) == first


def test_another_process_feels_the_same_to_the_bit() -> None:
    program = (
        "import sys; sys.path[:0] = ['.', 'tests/unit/sim']\n"
        "from test_world import DEFAULT, START, World, bits, wander\n"
        "World(DEFAULT).home(START)\n"
        "print('\\n'.join(bits(wander(World(DEFAULT), START, 7))))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert done.stdout.split() == bits(wander(World(DEFAULT), START, 7))


@pytest.mark.parametrize(
    "definition", [DEFAULT, SQUARE, RECTANGLE, TRIANGLE, CHAMFERLESS, RUBBER], ids=lambda d: d.name
)
def test_the_shortcut_agrees_with_full_physics(definition: Definition) -> None:
    quick, full = World(definition), World(definition, _always_physics=True)
    for start in (START, Pose.from_tilt(0.05, -0.05, -0.6, 0.1, 0.1, 0.0)):
        moves = [DOWN] * 60
        pairs = zip(drive(quick, start, moves), drive(full, start, moves), strict=True)
        for short, long in pairs:
            if short == NO_LOAD:
                assert size(long.force_n) < 0.02
            # Once in contact, friction may remember a different hair's breadth; only the free part must agree.
            if size(long.force_n) > 0.0:
                break


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_not_finite_is_refused_and_moves_nothing(bad: float) -> None:
    world = World(DEFAULT)
    world.home(START)
    with pytest.raises(ValueError, match="increment: expected finite numbers"):
        world.move(Increment(dx_mm=bad))
    with pytest.raises(ValueError, match="home pose: expected finite numbers"):
        world.home(START._replace(y_mm=bad))
    assert world.flange == START


def test_before_home_there_is_no_pose() -> None:
    with pytest.raises(RuntimeError, match="expected home"):
        World(DEFAULT).move(DOWN)


# -- square and rubber: forces that can be worked out by hand -----------------------------------------------------

SLIPPERY = {
    shape: Definition(name=f"slippery-{shape}", parts=parts, contact=Contact(friction=0.0))
    for shape, parts in {
        "square": Parts(shape="square", clearance_mm=0.2, peg_height_mm=13.3),
        "rectangle": Parts(shape="rectangle", peg_breadth_mm=14.0, clearance_mm=0.2, peg_height_mm=13.3),
        "triangle": Parts(shape="triangle", clearance_mm=0.2, peg_height_mm=13.3),
    }.items()
}
SLIPPERY_SQUARE = SLIPPERY["square"]
SIDE = 24.8
INRADIUS = SIDE / math.sqrt(12.0)
"""Of the triangle; its corners are twice as far from the axis."""


def soft(definition: Definition, stiffness_n_per_mm: float) -> Definition:
    return replace(definition, contact=Contact(friction=0.0, stiffness_n_per_mm=stiffness_n_per_mm))


@pytest.mark.parametrize(
    ("shape", "stiffness"),
    [
        *(("square", stiffness) for stiffness in (0.0, 5.0, 10.0, 40.0)),
        *((shape, stiffness) for shape in ("rectangle", "triangle") for stiffness in (0.0, 10.0)),
    ],
)
def test_a_corner_on_the_flat_top_is_springs_in_series(shape: str, stiffness: float) -> None:
    """Tilted by 10 and 10 degrees, one corner of the tip touches: the wrist's springs and the peg's surface."""
    definition = soft(SLIPPERY[shape], stiffness)
    # A triangle's corner is at -X: it is tilted about Y alone, which lowers it.
    tilted = Pose.from_tilt(0.0, 50.0, 0.0, 0.0 if shape == "triangle" else 10.0, 10.0)
    corners = {"square": (-12.4, 12.4, 0.0), "rectangle": (-12.4, 7.0, 0.0), "triangle": (-2 * INRADIUS, 0.0, 0.0)}
    corner = corners[shape]
    above = tilted._replace(z_mm=-rotate(tilted.orientation, corner)[2] - 0.05)
    world = World(definition)
    assert world.home(above) == NO_LOAD
    down = rotate(conjugate(tilted.orientation), (0.0, 0.0, 0.1))
    for _ in range(4):
        reading = world.move(Increment(*down))
    pressed = 4 * 0.1 - 0.05
    # Seen from the corner, a force along the hole's Z axis shifts the wrist and turns it about its anchor.
    lever = rotate(tilted.orientation, (corner[0], corner[1], 130.0))
    turning_mm_per_n = (lever[0] ** 2 + lever[1] ** 2) / 60_000.0
    surface_mm_per_n = 1.0 / stiffness if stiffness else 0.0
    expected = pressed / (1.0 / 15.0 + turning_mm_per_n + surface_mm_per_n)
    across_x, across_y, along = rotate(tilted.orientation, reading.force_n)
    assert along == pytest.approx(-expected, rel=0.02)
    assert math.hypot(across_x, across_y) < 0.01
    # The torque about the sensor is the lever times the force.
    torque = rotate(tilted.orientation, reading.torque_nm)
    assert torque[0] == pytest.approx(1e-3 * lever[1] * along, rel=0.03, abs=0.001)
    assert torque[1] == pytest.approx(-1e-3 * lever[0] * along, rel=0.03, abs=0.001)


def test_a_square_peg_on_its_chamfer_is_pushed_across_as_much_as_along() -> None:
    reading = press(World(SLIPPERY_SQUARE), Pose(1.0, 0.0, 1.9), 5)
    force, torque = reading.force_n, reading.torque_nm
    assert force[0] < -0.5
    assert force[0] / force[2] == pytest.approx(1.0, abs=0.1)
    assert abs(force[1]) < 0.02
    # A whole edge rests on the face, its middle 12.4 mm from the axis and 130 mm below the sensor: T = r x F.
    assert torque[1] == pytest.approx(0.130 * force[0] - 0.0124 * force[2], abs=0.005)
    assert abs(torque[0]) < 0.01


def test_a_triangular_peg_between_two_faces_of_its_chamfer_is_pushed_half_as_much_across_as_along() -> None:
    """Shifted to its corner at -X, it rests on both faces there, whose normals are 60 degrees off the shift."""
    reading = press(World(SLIPPERY["triangle"]), Pose(-1.6, 0.0, 1.9), 5)
    assert reading.force_n[0] > 0.3
    assert reading.force_n[0] / reading.force_n[2] == pytest.approx(-0.5, abs=0.05)
    assert abs(reading.force_n[1]) < 0.03
    straight = press(World(SLIPPERY["triangle"]), Pose(1.0, 0.0, 1.9), 5)
    assert straight.force_n[0] / straight.force_n[2] == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(
    ("shape", "stiffness"), [("square", 0.0), ("square", 10.0), ("rectangle", 0.0), ("triangle", 0.0)]
)
def test_a_peg_turned_in_its_hole_feels_a_torque_about_its_axis(shape: str, stiffness: float) -> None:
    """All corners touch from an angle on that the equation below gives."""
    world = World(soft(SLIPPERY[shape], stiffness))
    free = math.radians({"square": 0.932, "rectangle": 0.928, "triangle": 0.929}[shape])
    # Half the width times the sine, and half the other side times the cosine, reach the other side's wall.
    across = {"square": 12.4, "rectangle": 7.0, "triangle": INRADIUS}[shape]
    along = {"square": 12.4, "rectangle": 12.4, "triangle": SIDE / 2}[shape]
    assert across * math.cos(free) + along * math.sin(free) == pytest.approx(across + 0.2, abs=1e-3)
    world.home(Pose.from_tilt(0.0, 0.0, 6.0, 0.0, 0.0, 0.8))
    assert world.move(Increment(rz_deg=0.1)) == NO_LOAD
    for _ in range(4):
        reading = world.move(Increment(rz_deg=0.1))
    excess = math.radians(1.3) - free
    # Each side line touches in two points, 12.2 mm from the axis: eight springs in parallel, in series with the wrist.
    surface = 8.0 * stiffness * 12.2**2 * 1e-3
    turning = 60.0 * surface / (60.0 + surface) if stiffness else 60.0
    assert reading.torque_nm[2] == pytest.approx(-turning * excess, rel=0.12)
    assert size(reading.force_n) < 0.05
    assert math.hypot(*reading.torque_nm[:2]) < 0.01
    assert world.contact_state() != "free"


@pytest.mark.parametrize("definition", [DEFAULT, SQUARE, RECTANGLE, TRIANGLE], ids=lambda d: d.name)
def test_what_is_read_is_what_the_contacts_transmit(definition: Definition) -> None:
    """Balance of momentum: the impulses at all points that touch, and their moments, are the spring's load.

    Without friction, whose part PhysX does not tell.
    """
    world = World(soft(definition, 0.0))
    source, checked = random.Random(11), 0
    reading = world.home(START)
    for _ in range(150):
        force = size(reading.force_n)
        reading = world.move(DOWN if force < 0.3 else UP if force > 5.0 else source.choice(ACTIONS))
        again = world.move(Increment())
        if size(again.force_n) < 0.3 or math.dist(reading.force_n, again.force_n) > 0.005:
            continue  # free, or not yet at rest
        sensor = world.flange.point(-130.0)
        total, moment = [0.0] * 3, [0.0] * 3
        for at, pushed in world.touching():
            arm = [1e-3 * (a - b) for a, b in zip(at, sensor, strict=True)]
            total = [a + b for a, b in zip(total, pushed, strict=True)]
            turning = (arm[1] * pushed[2] - arm[2] * pushed[1], arm[2] * pushed[0] - arm[0] * pushed[2])
            moment = [a + b for a, b in zip(moment, (*turning, arm[0] * pushed[1] - arm[1] * pushed[0]), strict=True)]
        assert math.dist(total, rotate(world.flange.orientation, again.force_n)) < 0.02 + 0.02 * size(again.force_n)
        assert math.dist(moment, rotate(world.flange.orientation, again.torque_nm)) < 0.004 + 0.02 * size(
            again.torque_nm
        )
        checked += 1
    assert checked > 25


@pytest.mark.parametrize("definition", [DEFAULT, SQUARE, RECTANGLE, TRIANGLE, CHAMFERLESS], ids=lambda d: d.name)
def test_a_rigid_peg_does_not_sink_into_the_material(definition: Definition) -> None:
    world, geometry = World(definition), geometry_of(definition.parts)
    source = random.Random(3)
    reading, pressed = world.home(START), 0
    for _ in range(150):
        force = size(reading.force_n)
        reading = world.move(DOWN if force < 0.3 else UP if force > 5.0 else source.choice(ACTIONS))
        if size(reading.force_n) > 0.3:
            pressed += 1
            corners = [rotate(world.peg.orientation, tuple(corner)) for corner in peg_vertices(geometry).tolist()]
            for x, y, z in corners:
                x, y, z = x + world.peg.x_mm, y + world.peg.y_mm, z + world.peg.z_mm
                inside = geometry.wall(max(z, 0.0)) / math.cos(math.pi / geometry.sides if geometry.is_round else 0.0)
                reach = geometry.section.aside(x, y)
                assert z < 0.02 or reach < inside + 0.03
    assert pressed > 50


def test_a_soft_peg_of_the_same_friction_feels_less() -> None:
    rigid, rubber = World(soft(DEFAULT, 0.0)), World(soft(DEFAULT, 10.0))
    start = Pose.from_tilt(1.0, 0.0, 0.9, 0.0, -1.8, 0.0)
    hard, gentle = press(rigid, start, 6), press(rubber, start, 6)
    assert 0.3 < size(gentle.force_n) < 0.95 * size(hard.force_n)
