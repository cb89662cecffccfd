"""The window of a motion: so many samples after it that follow each other, never fewer and never others."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.rules.forces import spread
from services.rules.window import Rolling, Windows, mean, mean_load, unusable
from services.wire.definition import Sensor
from services.wire.messages import Force, FtPacket, Torque

MS = 1_000_000
COMPONENT = st.floats(-1e5, 1e5, allow_subnormal=False)


def load(number: int) -> tuple[Force, Torque]:
    """Return what sample ``number`` of these tests shows."""
    return (float(number), 0.0, -float(number)), (0.0, 0.5 * number, 0.0)


def packet(first: int, count: int, status: int = 0, period_ns: int = MS) -> FtPacket:
    """Return samples of a stream, sample ``n`` being taken at ``n`` milliseconds."""
    forces, torques = zip(*map(load, range(first, first + count)), strict=True)
    last = first + count - 1
    return FtPacket(
        sequence=last, t_ns=last * MS, period_ns=period_ns, status=status, force_n=forces, torque_nm=torques
    )


def numbers(window: FtPacket | None) -> list[int] | None:
    return None if window is None else [round(force[0]) for force in window.force_n]


def windows(samples: int = 4, rate_hz: int = 0) -> Windows:
    return Windows(Sensor(window=samples, rate_hz=rate_hz))


# -- the mean --------------------------------------------------------------------------------------------------------


@given(st.lists(st.tuples(COMPONENT, COMPONENT, COMPONENT), min_size=1, max_size=64))
def test_the_mean_is_the_mean(samples: list[Force]) -> None:
    assert np.allclose(mean(samples), np.mean(samples, axis=0), rtol=1e-12, atol=1e-9)


@given(st.tuples(COMPONENT, COMPONENT, COMPONENT), st.integers(1, 512))
def test_the_mean_of_equal_samples_is_the_sample_to_the_last_bit(sample: Force, count: int) -> None:
    assert mean([sample] * count) == sample


@given(st.lists(st.tuples(COMPONENT, COMPONENT, COMPONENT), min_size=1, max_size=64), st.integers(0, 63))
def test_the_mean_does_not_depend_on_where_a_round_of_samples_begins(samples: list[Force], turn: int) -> None:
    begun_later = samples[turn % len(samples) :] + samples[: turn % len(samples)]
    assert mean(begun_later) == mean(samples)
    assert spread(begun_later) == spread(samples)


def test_force_and_torque_of_a_packet_are_averaged() -> None:
    assert mean_load(packet(1, 3)) == ((2.0, 0.0, -2.0), (0.0, 1.0, 0.0))


@pytest.mark.parametrize(
    ("status", "why"), [(0, None), (2, None), (1, "saturated"), (4, "lost"), (8, "changed"), (16, "not yet zeroed")]
)
def test_a_status_says_whether_samples_can_be_used(status: int, why: str | None) -> None:
    assert unusable(status) == why


# -- the window of a motion --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("batch", [1, 2, 3, 8, 20])
def test_it_is_the_first_samples_after_the_motion(batch: int) -> None:
    seen = windows()
    seen.begin()
    for first in range(0, 40, batch):
        seen.take(packet(first, batch))
    window = seen.after(10 * MS)
    assert numbers(window) == [10, 11, 12, 13]
    assert window is not None
    assert (window.sequence, window.t_ns, window.period_ns, window.status) == (13, 13 * MS, MS, 0)


def test_it_is_the_same_whether_it_is_asked_for_after_each_packet_or_at_the_end() -> None:
    seen = windows(6)
    seen.begin()
    answers = []
    for first in range(0, 20, 2):
        seen.take(packet(first, 2))
        answers.append(numbers(seen.after(7 * MS)))
    assert next(answer for answer in answers if answer is not None) == [7, 8, 9, 10, 11, 12]
    assert answers[:6] == [None] * 6


def test_samples_taken_before_the_end_of_the_motion_never_count() -> None:
    seen = windows()
    seen.begin()
    seen.take(packet(0, 10))
    assert seen.after(10 * MS) is None
    seen.take(packet(10, 3))
    assert seen.after(10 * MS) is None, "a window that is not full"
    seen.take(packet(13, 1))
    assert numbers(seen.after(10 * MS)) == [10, 11, 12, 13]


def test_a_lost_sample_begins_it_anew() -> None:
    seen = windows()
    seen.begin()
    for one in (packet(10, 3), packet(14, 3)):  # 13 was lost
        seen.take(one)
    assert seen.after(10 * MS) is None
    assert seen.why == "samples were lost"
    seen.take(packet(17, 2))
    assert numbers(seen.after(10 * MS)) == [14, 15, 16, 17]


@pytest.mark.parametrize("status", [1, 4, 8, 16])
def test_samples_that_say_nothing_begin_it_anew(status: int) -> None:
    seen = windows()
    seen.begin()
    for one in (packet(10, 3), packet(13, 1, status), packet(14, 3)):
        seen.take(one)
    assert seen.after(10 * MS) is None
    assert "status" in seen.why
    seen.take(packet(17, 1))
    assert numbers(seen.after(10 * MS)) == [14, 15, 16, 17]


def test_what_was_felt_before_a_motion_was_asked_for_is_forgotten() -> None:
    seen = windows()
    seen.take(packet(0, 8))
    seen.begin()
    assert seen.after(0) is None


def test_another_rate_than_the_stated_one_is_no_window() -> None:
    seen = windows(rate_hz=7000)
    seen.begin()
    seen.take(packet(10, 8))
    assert seen.after(10 * MS) is None
    assert seen.why == "expected 7000 samples a second, as sensor.rate_hz says, got 1000"
    right = windows(rate_hz=1020)
    right.begin()
    right.take(packet(10, 8))
    assert right.after(10 * MS) is not None


def test_as_many_torques_as_forces_are_expected() -> None:
    seen = windows()
    seen.begin()
    whole = packet(10, 8)
    seen.take(FtPacket(sequence=17, t_ns=17 * MS, period_ns=MS, force_n=whole.force_n, torque_nm=whole.torque_nm[:-1]))
    assert seen.after(10 * MS) is None
    assert seen.why == "expected as many torques as forces, got 7 and 8"


def test_of_the_simulator_it_is_the_packet_of_the_very_motion() -> None:
    seen = windows()
    seen.begin()
    late, right = packet(50, 4, period_ns=0), packet(10, 4, period_ns=0)
    seen.take(late)
    assert seen.after(right.t_ns) is None, "of an episode that has begun anew since"
    seen.take(right)
    assert seen.after(right.t_ns) == right


def test_a_simulator_with_another_window_is_told_from_one_that_is_silent() -> None:
    seen = windows()
    seen.begin()
    short = packet(10, 3, period_ns=0)
    seen.take(short)
    assert seen.after(short.t_ns) is None
    assert seen.why == "expected 4 samples, as the definition says, got 3"


def test_a_window_of_one_is_the_newest_sample() -> None:
    seen = windows(1)
    seen.begin()
    for one in (packet(8, 4), packet(12, 4)):
        seen.take(one)
    newest = seen.after(10 * MS)
    assert newest == packet(12, 4)
    seen.take(packet(16, 1, status=1))
    assert seen.after(10 * MS) == newest, "one that is saturated is none"


# -- the guard's -----------------------------------------------------------------------------------------------------


def test_the_guard_sees_the_mean_of_the_newest_window() -> None:
    rolling = Rolling(4)
    assert rolling.take(packet(0, 2)).force_n == (mean([load(0)[0], load(1)[0]]),)
    shown = rolling.take(packet(2, 4))
    assert shown.force_n == ((3.5, 0.0, -3.5),)
    assert shown.torque_nm == ((0.0, 1.75, 0.0),)
    assert (shown.sequence, shown.t_ns) == (5, 5 * MS)


def test_the_guard_sees_a_bad_status_and_forgets_what_was_before() -> None:
    rolling = Rolling(4)
    rolling.take(packet(0, 4))
    bad = packet(4, 1, status=4)
    assert rolling.take(bad) == bad
    assert rolling.take(packet(5, 1)).force_n == (load(5)[0],)
    rolling.forget()
    assert rolling.take(packet(9, 1)).force_n == (load(9)[0],)


def test_a_window_of_one_leaves_packets_as_they_are() -> None:
    assert Rolling(1).take(packet(0, 4)) == packet(0, 4)


def test_noise_falls_with_the_root_of_the_window() -> None:
    draws = np.random.default_rng(5).standard_normal((2000, 64, 3)).tolist()
    means = np.array([mean([(x, y, z) for x, y, z in samples]) for samples in draws])
    assert means.std() == pytest.approx(1 / math.sqrt(64), rel=0.03)
