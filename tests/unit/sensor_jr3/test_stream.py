"""Samples to packets: what is lost is counted, counters wrap, and nothing that is bad waits for company."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.rules.ft_counts import FtCounts
from services.rules.mount import Mount
from services.rules.settings import SettingError
from services.sensor_jr3.card import Collected, Sample
from services.sensor_jr3.stream import Stream, pace_of, steps_between
from services.wire.messages import FtPacket

SCALE = FtCounts("1", (65, 65, 130, 50, 50, 50))
BEGAN_NS = 10**18


def stream(rate_hz: int = 8000, batch: int = 8) -> Stream:
    return Stream(SCALE, Mount(), pace_of(rate_hz), batch, first=100, after_ns=0)


def sample(counter: int, errors: int = 0, warnings: int = 0) -> Sample:
    return Sample(counter % 65536, (counter % 100, 0, 0, 0, 0, 0), warnings, errors)


def take(into: Stream, counters: list[int], newest_s: float = 0.0) -> list[FtPacket]:
    return list(into.take(Collected([sample(one) for one in counters], newest_s), BEGAN_NS))


@pytest.mark.parametrize(
    ("rate_hz", "counter", "every", "period_ns"),
    [
        (8000, 1, 1, 125_000),
        (4000, 1, 2, 250_000),
        (2000, 2, 1, 500_000),
        (1000, 2, 2, 1_000_000),
        (500, 3, 1, 2_000_000),
        (125, 4, 1, 8_000_000),
        (1600, 1, 5, 625_000),
        (8, 2, 250, 125_000_000),
    ],
)
def test_a_rate_watches_the_slowest_counter_that_is_fast_enough(
    rate_hz: int, counter: int, every: int, period_ns: int
) -> None:
    pace = pace_of(rate_hz)
    assert (pace.counter, pace.every, pace.period_ns) == (counter, every, period_ns)
    assert pace.step_ns == 125_000 * 4 ** (counter - 1)


@pytest.mark.parametrize("rate_hz", [0, -8, 3, 7, 3000, 8001, 16000])
def test_a_rate_that_no_counter_gives_is_refused(rate_hz: int) -> None:
    with pytest.raises(SettingError, match="a divisor of 8000 from 8 to 8000 Hz"):
        pace_of(rate_hz)


@pytest.mark.parametrize(
    ("before", "after", "expected", "steps"),
    [
        (5, 6, 1, 1),
        (65535, 0, 1, 1),
        (65530, 4, 10, 10),
        (5, 5, 0, 0),
        (5, 5, 65536, 65536),
        (5, 6, 65600, 65537),
        (5, 4, 65535, 65535),
        (6, 5, 3, 65535),
    ],
)
def test_a_counter_that_wraps_is_read_with_the_time(before: int, after: int, expected: int, steps: int) -> None:
    assert steps_between(before, after, expected) == steps


@given(st.integers(0, 65535), st.integers(0, 10**6), st.floats(-0.4, 0.4))
def test_steps_are_right_when_the_time_is_less_than_half_a_wrap_off(before: int, steps: int, off: float) -> None:
    expected = max(0, steps + int(off * 65536))
    assert steps_between(before, (before + steps) % 65536, expected) == steps


def test_samples_without_gaps_come_in_full_packets() -> None:
    into = stream()
    packets = take(into, list(range(65530, 65530 + 20)))
    assert [packet.sequence for packet in packets] == [108, 116]
    assert [len(packet.force_n) for packet in packets] == [8, 8]
    assert packets[0].force_n[0] == (30 * 65 / 16384, 0.0, 0.0)
    assert all(packet.period_ns == 125_000 and packet.status == 0 for packet in packets)
    assert (into.lost, into.taken) == (0, 20)
    assert [packet.sequence for packet in into.flush()] == [120]
    assert list(into.flush()) == []


def test_times_are_those_of_the_samples() -> None:
    into = stream(batch=2)
    first, second = take(into, [1, 2, 3, 4], newest_s=-0.001)
    assert second.t_ns == BEGAN_NS - 1_000_000
    assert first.t_ns == second.t_ns - 250_000


def test_a_clock_that_goes_back_does_not_take_times_back() -> None:
    into = stream(batch=1)
    times = [packet.t_ns for newest_s in (0.0, -5.0, -5.0, 0.5) for packet in take(into, [into.taken + 1], newest_s)]
    assert times == sorted(set(times))


def test_a_lost_sample_is_a_jump_and_never_inside_a_packet() -> None:
    into = stream()
    packets = take(into, [1, 2, 3, 7, 8, 9, 10, 11, 12, 13, 14])
    assert [(packet.sequence, len(packet.force_n)) for packet in packets] == [(103, 3), (114, 8)]
    assert into.lost == 3


def test_a_long_silence_is_counted_whole() -> None:
    into = stream(batch=1)
    take(into, [1])
    seconds = 20
    steps = seconds * 8000
    list(into.take(Collected([sample(1 + steps)], 0.0), BEGAN_NS + seconds * 10**9))
    assert into.lost == steps - 1
    assert into.sequence == 101 + steps


def test_the_same_sample_again_is_not_counted() -> None:
    into = stream(batch=1)
    assert len(take(into, [1])) == 1
    assert take(into, [1]) == []
    assert (into.taken, into.lost) == (1, 0)


def test_thinning_out_takes_every_second_and_loses_only_what_was_due() -> None:
    into = stream(rate_hz=4000, batch=1)
    assert [packet.sequence for packet in take(into, [1, 2, 3, 4, 5, 6])] == [101, 102, 103]
    assert [packet.sequence for packet in take(into, [8])] == [104]
    assert into.lost == 0
    assert take(into, [11]) == []
    assert into.lost == 1
    assert [packet.sequence for packet in take(into, [12])] == [106]


def test_trouble_is_told_at_once_and_marks_no_other_sample() -> None:
    into = stream()
    samples = [sample(1), sample(2), sample(3, errors=1), sample(4, errors=1), sample(5), sample(6)]
    packets = list(into.take(Collected(samples, 0.0), BEGAN_NS))
    assert [(packet.status, len(packet.force_n)) for packet in packets] == [(0, 2), (1, 1), (1, 1), (0, 1)]
    assert [packet.sequence for packet in packets] == [102, 103, 104, 105]


@given(
    st.lists(
        st.builds(
            Sample,
            st.integers(0, 65535),
            st.lists(st.integers(-32768, 32767), min_size=6, max_size=6).map(tuple),
            st.integers(0, 65535),
            st.integers(0, 65535),
        ),
        max_size=40,
    ),
    st.floats(-2.0, 2.0),
    st.sampled_from([8000, 1000, 500]),
    st.integers(1, 64),
)
def test_any_samples_give_packets_in_order(samples: list[Sample], newest_s: float, rate_hz: int, batch: int) -> None:
    into = stream(rate_hz, batch)
    packets = [*into.take(Collected(samples, newest_s), BEGAN_NS), *into.flush()]
    numbers = [packet.sequence for packet in packets]
    assert numbers == sorted(set(numbers))
    assert [packet.t_ns for packet in packets] == sorted({packet.t_ns for packet in packets})
    assert sum(len(packet.force_n) for packet in packets) == into.taken
    assert into.sequence - 100 == into.taken + into.lost


@pytest.mark.parametrize("batch", [0, 65])
def test_a_batch_that_no_packet_holds_is_refused(batch: int) -> None:
    with pytest.raises(SettingError, match="batch: expected 1 to 64"):
        stream(batch=batch)
