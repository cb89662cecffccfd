"""What is felt: fresh by its own number and time, late, of another source, alive."""

from __future__ import annotations

import math
import random

import pytest
from msgspec.structs import replace

from services.rules.senses import RISING, TURN_EVERY_S, Freshness, Senses
from services.wire.definition import Definition, Noise, Sensor
from services.wire.definition_file import load, shipped
from services.wire.messages import FtPacket

MS = 1_000_000
DAY = 1_700_000_000_000 * MS
NOISY = Definition(name="noisy", noise=Noise(force_n=0.04, torque_nm=0.0027))


def packet(number: int, load: tuple[float, ...] = (0.0,) * 6, ahead_ns: int = DAY) -> FtPacket:
    """Return the sample that is taken in a millisecond, with a sensor's clock that is ahead."""
    return FtPacket(
        sequence=number + 1,
        t_ns=ahead_ns + number * MS,
        period_ns=MS,
        force_n=((load[0], load[1], load[2]),),
        torque_nm=((load[3], load[4], load[5]),),
    )


def running(stream: Freshness, first: int = 0, count: int = 100, ahead_ns: int = DAY) -> int:
    """Feed a stream, each packet 1 ms late; return the time after it."""
    for number in range(first, first + count):
        stream.take(packet(number, ahead_ns=ahead_ns), (number + 1) * MS)
    return (first + count) * MS


def test_the_age_is_that_of_the_newest_sample() -> None:
    stream = Freshness()
    assert stream.age_s(0) == math.inf
    now_ns = running(stream)
    assert stream.age_s(now_ns) == 0.0
    assert stream.age_s(now_ns + 30 * MS) == pytest.approx(0.03)


@pytest.mark.parametrize("which", ["the last", "one number", "one time", "in circles"])
def test_packets_that_are_sent_again_renew_nothing(which: str) -> None:
    stream = Freshness()
    now_ns = end_ns = running(stream)
    newest = packet(99)
    for tick in range(300):
        now_ns += 10 * MS
        if which == "the last":
            again = newest
        elif which == "one number":
            again = replace(newest, t_ns=newest.t_ns + tick * MS)
        elif which == "one time":
            again = replace(newest, sequence=newest.sequence + tick)
        else:
            again = packet(98 + tick % 2)
        assert stream.take(again, now_ns) == "old"
    assert stream.age_s(now_ns) == pytest.approx((now_ns - end_ns) * 1e-9)


def test_a_recording_that_is_played_in_circles_is_believed_but_once_in_a_while() -> None:
    stream = Freshness()
    now_ns, taken = running(stream), 0
    for tick in range(900):
        now_ns += 10 * MS
        taken += stream.take(packet(tick % 50), now_ns) != "old"
    assert now_ns < TURN_EVERY_S * 1000 * MS
    assert taken <= 50


@pytest.mark.parametrize("back_s", [0.001, 20, 3600, 10**9])
def test_a_clock_that_was_set_back_is_taken_over_at_once(back_s: float) -> None:
    stream = Freshness()
    now_ns = running(stream)
    ahead_ns = DAY - round(back_s * 1e9) - 50 * MS
    taken = [stream.take(packet(100 + n, ahead_ns=ahead_ns), now_ns + (n + 1) * MS) for n in range(10)]
    assert taken == ["old"] * (RISING - 1) + ["other"] + ["new"] * (10 - RISING)
    assert stream.age_s(now_ns + 10 * MS) == 0.0


def test_a_clock_that_was_set_back_while_nothing_was_heard_is_no_delay_for_long() -> None:
    stream = Freshness()
    now_ns = running(stream) + 5000 * MS
    running(stream, now_ns // MS, 50, DAY - 3000 * MS)
    assert stream.age_s(now_ns + 50 * MS) == 0.0


def test_what_comes_late_is_old() -> None:
    """A network that stood still for 0.8 s gives all that it kept at once."""
    stream = Freshness()
    running(stream)
    now_ns = 900 * MS
    for number in range(100, 200):
        assert stream.take(packet(number), now_ns) == "new"
        assert stream.age_s(now_ns) > 0.6
    for number in range(200, 899):
        stream.take(packet(number), now_ns)
    assert stream.age_s(now_ns) < 0.002


# -- alive -----------------------------------------------------------------------------------------------------------


def motions_until_dead(definition: Definition, load_of: object, most: int = 200) -> int | None:
    """Move until the sensor is called dead, with a packet after each motion."""
    senses = Senses(definition)
    senses.homed()
    for number in range(most):
        load = load_of(number)  # type: ignore[operator]
        senses.take(packet(number, load), number * MS)
        if senses.dead():
            return number
        senses.moved()
    return None


@pytest.mark.parametrize("load", [(0.0,) * 6, (0.5, -0.25, 3.0, 0.1, 0.1, 0.1)])
@pytest.mark.parametrize("counted", [Sensor(), Sensor(full_scale_n=200, full_scale_dnm=120)])
def test_the_same_load_again_and_again_is_a_dead_sensor(load: tuple[float, ...], counted: Sensor) -> None:
    assert motions_until_dead(replace(NOISY, sensor=counted), lambda _: load) == 5


@pytest.mark.parametrize("axis", range(6))
def test_one_dead_axis_is_named(axis: int) -> None:
    draw = random.Random(1)

    def load(_: int) -> tuple[float, ...]:
        return tuple(0.0 if n == axis else draw.gauss(0.0, 0.04) for n in range(6))

    assert motions_until_dead(NOISY, load) is not None
    senses = Senses(NOISY)
    for number in range(21):
        senses.take(packet(number, load(number)), number * MS)
        senses.moved()
    assert f"the very same {('fx', 'fy', 'fz', 'tx', 'ty', 'tz')[axis]} in 21 motions" in (senses.dead() or "")


@pytest.mark.parametrize(
    "definition", [Definition(name="quiet"), replace(NOISY, noise=replace(NOISY.noise, scale=0.0))]
)
def test_where_no_noise_is_expected_nothing_is_dead(definition: Definition) -> None:
    assert motions_until_dead(definition, lambda _: (0.0,) * 6) is None


def test_counts_larger_than_the_noise_may_stay_the_same() -> None:
    coarse = replace(NOISY, sensor=Sensor(full_scale_n=32767, full_scale_dnm=32767))
    assert motions_until_dead(coarse, lambda _: (0.0,) * 6, 2000) is None


@pytest.mark.parametrize("name", shipped())
def test_an_honest_sensor_in_counts_is_never_dead(name: str) -> None:
    definition = load(name, ("sensor.full_scale_n=200", "sensor.full_scale_dnm=120"))
    draw, noise = random.Random(7), definition.noise

    def felt(_: int) -> tuple[float, ...]:
        force = [round(draw.gauss(0.0, noise.force_n) * 16384 / 200) * 200 / 16384 for _ in range(3)]
        torque = [round(draw.gauss(0.0, noise.torque_nm) * 16384 / 12) * 12 / 16384 for _ in range(3)]
        return (*force, *torque)

    assert motions_until_dead(definition, felt, 3000) is None


def test_standing_still_says_nothing() -> None:
    """An emulated card shows the last load until the next motion, however long that takes."""
    senses = Senses(NOISY)
    senses.moved()
    for number in range(10_000):
        senses.take(packet(number), number * MS)
    assert senses.dead() is None
