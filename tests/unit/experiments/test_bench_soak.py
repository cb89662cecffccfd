"""``bench soak``: growth and loss are told where they are."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.bench.__main__ import main
from experiments.bench.cell import Subject
from experiments.bench.ft_stream import PERIOD_NS, SAMPLES_PER_S, Delays, Received, samples
from experiments.bench.processes import MB, Usage, slope_per_h, usage
from experiments.bench.soak import Sample, Stream, report
from services.wire.codec import decode_payload, encode
from services.wire.errors import CellError
from services.wire.messages import FtPacket

SUBJECT = Subject("x", (), 0)
SENT = {"samples": 16000, "seconds": 2.0, "late_median_ms": 0.1, "late_p99_ms": 0.2, "late_max_ms": 3.0}
RECEIVED = {
    **{"samples": 16000, "lost": 0, "gaps": 0, "out_of_order": 0, "refused": 0},
    **{"median_ms": 0.3, "p99_ms": 1.9, "max_ms": 7.0},
}
GOOD = Stream(True, SENT, RECEIVED)


def history(
    growth_mb_per_h: float, sizes_mb: Sequence[float] = (1.0,) * 181, forgot: Sequence[int] = (0,) * 181
) -> Any:
    """Return half an hour of a process that fills up for 10 minutes and grows from then on; 3 episodes a second."""
    found = []
    for number, (size, times) in enumerate(zip(sizes_mb, forgot, strict=True)):
        seconds = 10.0 * number
        level = 50 + seconds / 10 if seconds < 600 else 110 + growth_mb_per_h * (seconds - 600) / 3600
        agent = Usage(round(level * MB), 5 + seconds / 4)
        found.append(Sample(seconds, 3 * 10 * number, 60 * 10 * number, {"agent": agent}, round(size * MB), times))
    return found


def part(found: Mapping[str, Any], *names: str) -> Any:
    """Return a figure from inside a report."""
    value: Any = found
    for name in names:
        value = value[name]
    return value


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.integers(2, 50))
def test_the_slope_is_that_of_a_line(slope: float, level: float, count: int) -> None:
    times = [36.0 * number for number in range(count)]
    assert slope_per_h(times, [level + slope * time / 3600 for time in times]) == pytest.approx(slope, abs=1e-6)


def test_the_slope_is_the_one_of_least_squares() -> None:
    # By hand: times 0, 1, 2, 3 h about their mean, and values 1, 3, 2, 6.
    assert slope_per_h([0, 3600, 7200, 10800], [1, 3, 2, 6]) == pytest.approx((-1.5 - 1.5 + 1 + 9) / 5)
    assert slope_per_h([5.0], [1.0]) == slope_per_h([5.0, 5.0], [1.0, 2.0]) == 0.0


@pytest.mark.parametrize(("growth", "word"), [(0.0, "flat"), (2.0, "flat"), (-40.0, "flat"), (4.0, "grows")])
def test_memory_is_judged_after_the_warm_up(growth: float, word: str) -> None:
    found = report(SUBJECT, 8, 200, history(growth), GOOD)
    agent = part(found, "processes", "agent")
    assert agent["memory"] == word
    assert agent["slope_mb_per_h"] == pytest.approx(growth, abs=1e-3)
    assert agent["rise_mb"] == pytest.approx(growth / 3, abs=1e-3)
    assert agent["cpu_percent"] == pytest.approx(25.0)
    assert found["all_flat"] is (word == "flat")
    assert found["smallest_growth_told_mb_per_h"] == pytest.approx(3.0)
    assert found["decisions_per_s"] == pytest.approx(60.0)


def saw(rise_per_cycle_mb: float, cycles: int) -> tuple[list[float], list[int]]:
    """Return sizes and how often was forgotten, of a store that forgets every 30 samples; each peak is higher."""
    forgot = [number * cycles // 181 for number in range(181)]
    each = 181 / cycles
    return [2 + (number % each) / each + rise_per_cycle_mb * forgot[number] for number in range(181)], forgot


@pytest.mark.parametrize(
    ("rise", "cycles", "word"),
    [(0.0, 6, "bounded"), (0.5, 6, "grows"), (0.0, 3, "too short to say"), (0, 4, "bounded")],
)
def test_a_store_is_bounded_when_its_peaks_stay(rise: float, cycles: int, word: str) -> None:
    found = report(SUBJECT, 8, 200, history(0.0, *saw(rise, cycles)), GOOD)
    assert part(found, "store", "size") == word
    assert part(found, "store", "forgot") == cycles - 1
    # While it fills: 1 MB in so many samples of 30 episodes.
    per_episode = 1e6 / (181 / cycles) / 30
    assert part(found, "store", "bytes_per_episode_while_filling") == pytest.approx(per_episode, rel=1e-3)


def test_a_store_that_holds_longer_episodes_may_be_larger_in_proportion() -> None:
    sizes, forgot = saw(0.0, 6)
    # From the third cycle on, episodes are twice as long and take twice the room.
    sizes = [size * (2 if times > 2 else 1) for size, times in zip(sizes, forgot, strict=True)]
    longer = 2 * 60 * 10
    samples, decisions = [], 0
    for sample in history(0.0, sizes, forgot):
        samples.append(sample._replace(decisions=decisions))
        decisions += longer if sample.forgot > 2 else longer // 2
    assert part(report(SUBJECT, 8, 200, samples, GOOD), "store", "size") == "bounded"
    assert part(report(SUBJECT, 8, 200, history(0.0, sizes, forgot), GOOD), "store", "size") == "grows"


@pytest.mark.parametrize(
    ("change", "met"), [({}, True), ({"samples": 15992.0}, False), ({"p99_ms": 2.0}, False), ({"max_ms": 99.0}, True)]
)
def test_the_stream_meets_its_target_without_loss_and_in_time(change: dict[str, float], met: bool) -> None:
    stream = part(report(SUBJECT, 8, 200, history(0.0), Stream(True, SENT, {**RECEIVED, **change})), "ft_stream")
    assert stream["target_met"] is met
    assert stream["samples_lost"] == 16000 - change.get("samples", 16000)
    assert stream["samples_per_s"] == 8000.0
    assert stream["oldest_sample_p99_ms"] == pytest.approx(stream["latency_p99_ms"] + 7 / 8)


def packet(first: int, count: int = 8, t_ns: int = 0) -> FtPacket:
    return FtPacket(
        sequence=first + count - 1, t_ns=t_ns, force_n=((0.0, 0.0, 0.0),) * count, torque_nm=((0.0, 0.0, 0.0),) * count
    )


def test_a_gap_is_counted_with_all_its_samples() -> None:
    received = Received()
    for first in (0, 8, 32, 40, 48 + 5 * 8):
        received.take(packet(first, t_ns=1000), 1000)
    assert (received.samples, received.lost, received.gaps) == (40, 16 + 40, 2)


def test_samples_that_never_came_at_the_beginning_are_lost_too() -> None:
    received = Received()
    received.take(packet(800), 0)
    assert (received.lost, received.gaps) == (800, 1)


def test_what_comes_again_or_too_late_is_not_counted_twice() -> None:
    received = Received()
    for first in (0, 16, 8, 16, 24):
        received.take(packet(first), 0)
    assert (received.samples, received.lost, received.out_of_order) == (24, 8, 2)


@given(st.lists(st.integers(0, 999_000_000), min_size=1, max_size=60), st.sampled_from([1, 50, 99, 100]))
def test_a_percentile_of_delays_is_right_to_10_us(delays: list[int], percent: int) -> None:
    kept = Delays()
    for delay in delays:
        kept.add(delay)
    ordered = sorted(delays)
    exact_ms = ordered[max(1, -(-len(ordered) * percent // 100)) - 1] / 1e6
    assert exact_ms <= kept.percentile_ms(percent) <= exact_ms + 0.01
    assert kept.max_ms == max(delays) / 1e6


def test_delays_out_of_range_are_not_lost() -> None:
    kept = Delays()
    assert kept.percentile_ms(50) == 0.0
    for delay in (-5, 3_000_000_000):
        kept.add(delay)
    assert kept.percentile_ms(50) == 0.01
    assert kept.percentile_ms(99) == kept.max_ms == 3000.0


def test_simulated_samples_are_samples_of_the_contract_and_move() -> None:
    force_n, torque_nm = samples()
    assert len(force_n) == len(torque_nm) == SAMPLES_PER_S == 1_000_000_000 // PERIOD_NS
    made = FtPacket(sequence=63, t_ns=0, period_ns=PERIOD_NS, force_n=force_n[:64], torque_nm=torque_nm[:64])
    assert decode_payload(FtPacket, encode(made)) == made
    assert len(set(force_n)) > 7900


def test_memory_of_a_process_is_read_until_it_ends() -> None:
    mine = usage(os.getpid())
    assert 10 * MB < mine.rss_bytes < 10_000 * MB
    assert mine.cpu_s > 0
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        with pytest.raises(CellError, match=r"expected sensor .* to run, it has ended"):
            usage(process.pid, "sensor")  # ended, and not yet waited for


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--minutes", "0"), "0.01 to"),
        (("--minutes", "nan"), "'nan'"),
        (("--in-packet", "7"), "7"),
        (("--rounds", "2"), "rounds"),
    ],
)
def test_a_soak_that_cannot_be_is_one_line(
    words: tuple[str, ...], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["soak", *words])
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line
