"""Samples become forces fit to learn from; a zero that cannot be one is refused with the reason."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace

from services.rules.forces import FEWEST, Forces, TareError, spread
from services.rules.front_end import FrontEnd
from services.rules.motions import DeadSensorError, GuardError, Robot
from services.wire.actions import Increment
from services.wire.definition import Calibration, Definition, Limits, Sensor, Start, Wrist
from services.wire.definition_rules import contradiction
from services.wire.felt_noise import contact_force_n, felt_sigma_n
from services.wire.messages import Force, FtPacket, Home, Move, Torque

RUN = "forces-s0"
MS = 1_000_000
CALIBRATION = Calibration(
    sigma_n=0.1, sigma_nm=0.01, weight_z_n=5.0, centre_x_mm=10.0, centre_z_mm=70.0, zero_fx_n=0.5, zero_tz_nm=-0.1
)
SETTINGS = Definition(
    name="forces",
    sensor=Sensor(window=4, tare_samples=32, tare_step_n=0.5, tare_most_n=3.0, contact_sigmas=5.0),
    calibration=CALIBRATION,
    start=Start(rx_deg=0.0, ry_deg=0.0, tilt_spread_deg=10.0),
    limits=Limits(hard_force_n=30.0),
)
STRAIGHT = Home(run=RUN, episode=0, x_mm=1.6, y_mm=-2.2, z_mm=-1.0, rx_deg=0.0, ry_deg=0.0, rz_deg=0.0)
TILTED = replace(STRAIGHT, rx_deg=8.0, ry_deg=-5.0)
WEIGHT: tuple[Force, Torque] = ((0.0, 0.0, 5.0), (0.0, -0.05, 0.0))
"""Of the straight tool, about the sensor's point: 5 N at 10 mm aside."""


def samples(
    force_n: Force, torque_nm: Torque = (0.0, 0.0, 0.0), count: int = 32, sigma_n: float = 0.1, first: int = 0
) -> FtPacket:
    """Return samples that show a load beside the noise of a calibrated sensor."""
    draw = np.random.default_rng(first).standard_normal((count, 6)) * np.array([sigma_n] * 3 + [sigma_n / 10] * 3)
    rows = (np.array((*force_n, *torque_nm)) + draw - draw.mean(axis=0)).tolist()
    forces: tuple[Force, ...] = tuple((x, y, z) for x, y, z, *_ in rows)
    torques: tuple[Torque, ...] = tuple((x, y, z) for *_, x, y, z in rows)
    last = first + count - 1
    return FtPacket(sequence=last, t_ns=last * MS, period_ns=MS, force_n=forces, torque_nm=torques)


def shown(
    zero_n: Force = (0.5, 0.0, 0.0), load_n: Force = (0.0, 0.0, 0.0), count: int = 32, first: int = 0
) -> FtPacket:
    """Return what the straight tool's sensor shows with a zero and a load on the peg."""
    force = tuple(zero + weight + load for zero, weight, load in zip(zero_n, WEIGHT[0], load_n, strict=True))
    x, y, z = force
    return samples((x, y, z), (0.0, -0.05, -0.1), count, first=first)


def forces(definition: Definition = SETTINGS, home: Home = STRAIGHT) -> Forces:
    made = Forces(definition)
    made.home(home)
    return made


def near(load: tuple[Force, Torque], force_n: Force, torque_nm: Torque = (0.0, 0.0, 0.0)) -> bool:
    return np.allclose(load[0], force_n, atol=1e-9) and np.allclose(load[1], torque_nm, atol=1e-9)


# -- zero and weight ---------------------------------------------------------------------------------------------------


def test_by_default_the_newest_sample_is_felt_bit_by_bit() -> None:
    made, packet = forces(Definition(name="plain")), samples((1.0, 2.0, 3.0))
    assert made.changes_nothing
    assert made.felt(packet) == (packet.force_n[-1], packet.torque_nm[-1])


def test_a_tare_in_the_air_makes_the_air_nothing() -> None:
    made = forces()
    zero = made.tare(shown())
    assert near((zero.force_n, zero.torque_nm), (0.5, 0.0, 0.0), (0.0, 0.0, -0.1))
    assert zero.step == 0
    assert zero.sigma_n == pytest.approx(0.1, rel=0.3)
    assert near(made.felt(shown(count=4)), (0.0, 0.0, 0.0))
    assert near(made.felt(shown(load_n=(1.0, -2.0, -3.0), count=4)), (1.0, -2.0, -3.0))


def test_without_a_tare_the_zero_is_the_calibration_s() -> None:
    made = forces(replace(SETTINGS, sensor=replace(SETTINGS.sensor, tare_samples=0)))
    assert near(made.felt(shown(load_n=(0.0, 0.0, -2.0), count=4)), (0.0, 0.0, -2.0))


@pytest.mark.parametrize("home", [STRAIGHT, TILTED])
def test_the_weight_follows_the_tool_as_it_is_turned(home: Home) -> None:
    """What a tool that is turned by R shows of its weight is R^T weight, reckoned here by numpy."""
    made = forces(home=home)
    turn = turned(home.rx_deg, home.ry_deg, home.rz_deg)
    made.tare(weighed(turn, 32))
    for increment in (Increment(rx_deg=0.2), Increment(ry_deg=-0.2), Increment(dx_mm=0.2), Increment(rz_deg=3.0)):
        made.moved(increment)
        turn = turn @ turned(*increment[3:])
        assert near(made.felt(weighed(turn, 4)), (0.0, 0.0, 0.0))


def test_without_the_calibrated_weight_a_tilt_is_felt_as_a_force() -> None:
    light = replace(
        SETTINGS,
        calibration=replace(CALIBRATION, weight_z_n=0.0),
        sensor=Sensor(window=4, tare_samples=32, tare_most_n=10.0),
    )
    made = forces(light)
    made.tare(weighed(turned(0, 0, 0), 32))
    made.moved(Increment(rx_deg=3.0))
    assert math.hypot(*made.felt(weighed(turned(3.0, 0, 0), 4))[0]) == pytest.approx(
        5.0 * math.sin(math.radians(3.0)), rel=0.01
    )


def test_a_sensor_that_is_mounted_turned_feels_the_weight_along_its_own_axes() -> None:
    made = forces(replace(SETTINGS, wrist=Wrist(sensor_rx_deg=90.0)))
    mount, tool = turned(90.0, 0.0, 0.0), turned(0.0, 0.0, 0.0)
    made.tare(weighed(tool @ mount, 32))
    tool = tool @ turned(5.0, 0.0, 0.0)
    made.moved(Increment(rx_deg=5.0))
    assert near(made.felt(weighed(tool @ mount, 4)), (0.0, 0.0, 0.0))


def turned(rx_deg: float, ry_deg: float, rz_deg: float) -> np.ndarray:
    (cx, sx), (cy, sy), (cz, sz) = (
        (math.cos(math.radians(a)), math.sin(math.radians(a))) for a in (rx_deg, ry_deg, rz_deg)
    )
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    made: np.ndarray = about_z @ about_y @ about_x
    return made


def weighed(turn: np.ndarray, count: int) -> FtPacket:
    """Return what a sensor turned so shows of the weight and of the calibrated zero."""
    force = turn.T @ np.array([0.0, 0.0, 5.0])
    torque = np.cross([0.01, 0.0, 0.07], force)
    (fx, fy, fz), (tx, ty, tz) = np.add(force, (0.5, 0.0, 0.0)).tolist(), np.add(torque, (0.0, 0.0, -0.1)).tolist()
    return samples((fx, fy, fz), (tx, ty, tz), count)


# -- what cannot be a zero ---------------------------------------------------------------------------------------------


def refusal(packet: FtPacket, *, before: FtPacket | None = None) -> str:
    made = forces()
    if before is not None:
        made.tare(before)
    with pytest.raises(TareError) as caught:
        made.tare(packet, follows=before is not None)
    assert near(made.felt(shown(count=4)), (0.0, 0.0, 0.0)), "the zero stays what it was"
    return str(caught.value)


def test_a_tool_heavier_by_a_kilogram_is_named() -> None:
    assert refusal(shown(load_n=(0.0, 0.0, 9.81))) == (
        "tare: expected a zero within 3 N of that of the calibration, got 9.81 N more; "
        "is the tool 1.00 kg heavier than calibrated, or pressed on something?"
    )
    assert "0.41 kg lighter" in refusal(shown(load_n=(0.0, 0.0, -4.0)))


def test_a_tare_in_contact_is_refused_by_the_zero_before_it() -> None:
    assert refusal(shown(load_n=(0.0, 0.6, 0.0)), before=shown()) == (
        "tare: expected a zero within 0.5 N of that of the tare before, got 0.60 N more; "
        "is the tool in the air, and the sensor the one that was calibrated?"
    )


def test_a_torque_alone_betrays_a_contact_too() -> None:
    x, y, z = shown().force_n[0]
    assert refusal(samples((0.5, 0.0, 5.0), (0.5, -0.05, -0.1))).startswith(
        "tare: expected a zero within 0.39 N m of that of the calibration, got 0.5 N m more"
    ), (x, y, z)


def test_a_sensor_that_was_switched_off_has_another_zero() -> None:
    """A slow wander is followed; a jump is not."""
    made = forces()
    for step in range(8):
        made.tare(shown(zero_n=(0.5 + 0.3 * step, 0.0, 0.0)), follows=step > 0)
    with pytest.raises(TareError, match=r"within 0\.5 N of that of the tare before, got 0\.90 N more"):
        made.tare(shown(zero_n=(1.7, 0.0, 0.0)), follows=True)
    assert made.tare(shown(zero_n=(1.7, 0.0, 0.0))).force_n[0] == pytest.approx(1.7), "somebody has looked"


def test_a_wander_that_adds_up_is_refused_by_the_calibration() -> None:
    made = forces()
    with pytest.raises(TareError, match="within 3 N of that of the calibration"):
        for step in range(20):
            made.tare(shown(zero_n=(0.5, 0.3 * step, 0.0)), follows=step > 0)


def test_noise_that_is_suddenly_larger_is_refused() -> None:
    loud = samples((0.5, 0.0, 5.0), (0.0, -0.05, -0.1), sigma_n=0.25)
    assert refusal(loud).startswith("tare: expected noise of at most 2 times the 0.1 N of the calibration, got 0.2")


def test_noise_of_the_calibrated_size_never_is() -> None:
    """A window of the fewest samples shows twice the noise once in a thousand million."""
    draws = np.random.default_rng(3).standard_normal((3000, FEWEST, 3))
    spreads = [spread([(x, y, z) for x, y, z in rows]) for rows in draws.tolist()]
    assert max(spreads) < 1.6
    assert np.mean(np.square(spreads)) == pytest.approx(1.0, rel=0.02)


# -- what counts as contact --------------------------------------------------------------------------------------------


def test_contact_counts_from_a_multiple_of_the_noise_of_what_is_felt() -> None:
    assert felt_sigma_n(SETTINGS) == pytest.approx(0.1 * math.sqrt(1 / 4 + 1 / 32))
    assert contact_force_n(SETTINGS) == pytest.approx(max(0.3, 5 * felt_sigma_n(SETTINGS)))
    assert contact_force_n(replace(SETTINGS, calibration=replace(CALIBRATION, sigma_n=1e-3))) == 0.3, "at least that"
    assert contact_force_n(Definition(name="plain")) == 0.3


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"sensor": Sensor(tare_samples=8)}, "sensor.tare_samples"),
        ({"sensor": Sensor(window=8, tare_samples=4), "calibration": CALIBRATION}, "sensor.tare_samples"),
        ({"sensor": Sensor(contact_sigmas=5.0)}, "sensor.contact_sigmas"),
        ({"sensor": Sensor(contact_sigmas=100.0), "calibration": CALIBRATION}, "sensor.contact_sigmas"),
        ({"calibration": replace(CALIBRATION, residual_n=0.2)}, "calibration.residual_n"),
        ({"calibration": CALIBRATION, "wrist": Wrist(sensor_mount="unknown")}, "calibration.sigma_n"),
    ],
)
def test_what_needs_a_calibration_is_refused_without_a_good_one(settings: dict[str, object], key: str) -> None:
    conflict = contradiction(replace(Definition(name="plain"), **settings))
    assert conflict is not None
    assert conflict[0] == key


# -- the guard's front end ---------------------------------------------------------------------------------------------


def down(step: int) -> Move:
    return Move(run=RUN, episode=0, step=step, dz_mm=0.2)


def robot() -> tuple[Robot, int]:
    """Return a robot at the start pose whose zero was taken, and the number of the next sample."""
    made = Robot(SETTINGS, RUN)
    made.home(STRAIGHT)
    made.homed(STRAIGHT, 0)
    return made, feed(made, shown(first=0))


def feed(made: Robot, packet: FtPacket) -> int:
    made.feel(packet, packet.t_ns)
    return packet.sequence + 1


def test_a_heavy_tool_is_no_force_to_the_guard() -> None:
    """5 N of weight, a collision from 4 N: the guard sees what the surroundings do."""
    sharp = replace(SETTINGS, limits=Limits(collision_force_n=4.0, hard_force_n=30.0))
    made = Robot(sharp, RUN)
    made.home(STRAIGHT)
    made.homed(STRAIGHT, 0)
    first = feed(made, shown(first=0))
    made.move(down(1), first * MS)
    pressed = shown(load_n=(0.0, 0.0, -4.5), count=4, first=first)
    feed(made, pressed)
    with pytest.raises(GuardError, match=r"force: expected less than the 4\.0 N of a collision, got 4\.5"):
        made.move(down(1), pressed.t_ns)


def test_nothing_moves_before_the_zero_is_taken() -> None:
    made = Robot(SETTINGS, RUN)
    made.home(STRAIGHT)
    made.homed(STRAIGHT, 0)
    first = feed(made, shown(count=31))
    with pytest.raises(GuardError, match="tare: expected the zero of this episode to be taken before it moves"):
        made.move(down(1), first * MS)
    feed(made, shown(count=1, first=first))
    made.move(down(1), first * MS)


def test_a_tare_that_is_refused_holds_the_arm_until_somebody_has_looked() -> None:
    made, first = robot()
    again = replace(STRAIGHT, episode=1)
    made.home(again)
    made.homed(again, first * MS)
    first = feed(made, shown(zero_n=(1.5, 0.0, 0.0), first=first))
    assert "of the tare before, got 1.00 N more" in (made.numb() or "")
    assert made.sensing(first * MS) == made.numb()
    with pytest.raises(DeadSensorError, match="guard: tare: "):
        made.move(replace(down(1), episode=1), first * MS)
    made.home(again)
    made.homed(again, first * MS)
    first = feed(made, shown(zero_n=(1.5, 0.0, 0.0), first=first))
    assert made.numb() is not None, "asking again is nobody's deliberate act"
    made.resumed()
    made.home(again)
    made.homed(again, first * MS)
    first = feed(made, shown(zero_n=(1.5, 0.0, 0.0), first=first))
    assert made.numb() is None
    made.move(replace(down(1), episode=1), first * MS)


@pytest.mark.parametrize("status", [4, 8, 16])
def test_a_sensor_that_was_lost_since_its_tare_is_another_one(status: int) -> None:
    made, first = robot()
    bad = replace(shown(count=1, first=first), status=status)
    first = feed(made, bad)
    first = feed(made, shown(count=8, first=first))
    assert (
        made.numb() == "guard: tare: expected the sensor of the tare, got one that began anew since; only home is taken"
    )
    with pytest.raises(DeadSensorError):
        made.move(down(1), first * MS)
    made.home(STRAIGHT)
    made.homed(STRAIGHT, first * MS)
    feed(made, shown(zero_n=(2.5, 0.0, 0.0), first=first))
    assert made.numb() is None, "its zero need not be near the one before"


def test_a_sensor_whose_numbers_begin_anew_is_another_one() -> None:
    made, first = robot()
    made.move(down(1), first * MS)
    for number in range(3):
        packet = replace(shown(count=1), sequence=number, t_ns=number * MS)
        taken = made.feel(packet, (first + number) * MS)
    assert taken == "other"
    assert "began anew" in (made.numb() or "")


def test_a_saturated_sample_is_no_other_sensor() -> None:
    made, first = robot()
    first = feed(made, replace(shown(count=1, first=first), status=1))
    first = feed(made, shown(count=4, first=first))
    assert made.numb() is None
    made.move(down(1), first * MS)


def test_what_stops_a_motion_goes_by_single_samples_without_the_weight() -> None:
    made, first = robot()
    assert made.pressing(shown(count=4, first=first)) is None
    spike = samples((0.5, 0.0, 5.0 - 31.0), (0.0, 0.0, 0.0), count=1, first=first)
    assert made.pressing(spike) == "robot: expected at most 30.0 N in a motion, got 31.00 N; told to abort"


def test_without_a_tare_the_front_end_shows_packets_as_they_are() -> None:
    front, packet = FrontEnd(Definition(name="plain")), shown()
    front.homed(STRAIGHT, 0)
    assert front.take(packet) is packet
    front.began_anew()
    assert (front.trouble, front.waits) == (None, False)
