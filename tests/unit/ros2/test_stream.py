"""Samples as packets: in order and in time, or refused with the reason."""

from __future__ import annotations

import pytest

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")

import itertools

from services.ros2.attachment import Attachment
from services.ros2.errors import ClockError, FrameError, SampleError
from services.ros2.messages import Wrench
from services.ros2.stream import LOST, NS, Stream
from services.rules.mount import Mount
from services.wire.messages import FtPacket

DAY_NS = 1_764_000_000 * NS
MS = 10**6
ONE, OTHER = bytes(16), bytes([1] * 16)
AHEAD_NS = -7 * NS
"""Of the driver's clock before ours."""


@pytest.fixture
def stream() -> Stream:
    return Stream("tool0", 500.0, Mount(), 0.05)


def came(
    stream: Stream, number: int, at_ms: float, late_ms: float = 0.1, gid: bytes = ONE, frame: str = "tool0", **more: int
) -> FtPacket:
    """Take a sample that was measured at a time and came later."""
    stamp_ns = more.get("stamp_ns", DAY_NS + AHEAD_NS + round(at_ms * MS))
    wrench = Wrench(stamp_ns, frame, (float(number), 0.0, 0.0), (0.0, 0.0, 0.0))
    return stream.take(wrench, Attachment(number, 0, gid), DAY_NS + round((at_ms + late_ms) * MS))


def test_samples_follow_each_other_by_number_and_by_our_time(stream: Stream) -> None:
    packets = [came(stream, number, 2.0 * number, late_ms=0.1 + number % 3) for number in range(1, 20)]
    assert [packet.force_n[0][0] for packet in packets] == list(map(float, range(1, 20)))
    steps = [(b.sequence - a.sequence, b.t_ns - a.t_ns) for a, b in itertools.pairwise(packets)]
    assert all(step == 1 and t_ns > 0 for step, t_ns in steps)
    assert abs(packets[-1].t_ns - (DAY_NS + 38 * MS)) < 3 * MS, "on our time of day, though the driver's is another"
    assert {packet.status for packet in packets} == {0} and stream.lost == 0


def test_a_sample_that_did_not_come_is_a_jump_in_the_numbers(stream: Stream) -> None:
    first, second = came(stream, 1, 2), came(stream, 4, 8)
    assert second.sequence - first.sequence == 3 and stream.lost == 2


def test_who_begins_anew_does_not_begin_at_0(stream: Stream) -> None:
    before = came(stream, 1, 2)
    after = came(Stream("tool0", 500.0, Mount(), 0.05), 1, 1000)
    assert after.sequence > before.sequence and after.t_ns > before.t_ns


@pytest.mark.parametrize(
    ("number", "at_ms", "more", "why"),
    [
        (5, 12, {}, "repeated"),
        (4, 12, {}, "unordered"),
        (6, 10, {}, "the same: repeated"),
        (6, 12, {"late_ms": 80.0}, r"expected one of at most 0\.05 s ago"),
        (6, 12, {"gid": OTHER}, "expected one on the topic, got a sample of another one"),
        (6, 12, {"frame": "base"}, r"expected 'tool0' \(--frame\), got 'base'"),
        (6, 12, {"stamp_ns": 0}, "expected the time of the sample in its header, got 0"),
    ],
)
def test_what_is_not_the_next_sample_is_refused(
    stream: Stream, number: int, at_ms: float, more: dict[str, object], why: str
) -> None:
    for before in range(1, 6):
        came(stream, before, 2.0 * before)
    with pytest.raises(SampleError, match=why):
        came(stream, number, at_ms, **more)  # type: ignore[arg-type]
    assert came(stream, 7, 14).force_n == ((7.0, 0.0, 0.0),), "what follows is taken"


@pytest.mark.parametrize("jump_s", [-3600.0, -0.001, 1.5, 86400.0])
def test_a_clock_that_jumps_is_told_and_then_followed(stream: Stream, jump_s: float) -> None:
    for number in range(1, 6):
        before = came(stream, number, 2.0 * number)
    stamp_ns = DAY_NS + AHEAD_NS + 10 * MS + round(jump_s * NS)
    with pytest.raises(ClockError, match="it jumped by"):
        came(stream, 6, 12, stamp_ns=stamp_ns)
    after = came(stream, 7, 14, stamp_ns=stamp_ns + 2 * MS)
    assert after.t_ns > before.t_ns and abs(after.t_ns - (DAY_NS + 14 * MS)) < MS, "still on our time of day"


def test_a_status_comes_after_what_was_felt_and_before_what_follows(stream: Stream) -> None:
    felt = came(stream, 1, 2)
    told = stream.say(LOST, DAY_NS + 3 * MS)
    after = came(stream, 2, 4)
    assert felt.sequence < told.sequence < after.sequence and felt.t_ns < told.t_ns < after.t_ns
    assert told.status == LOST and told.force_n == felt.force_n


def test_a_mounting_turns_what_is_felt() -> None:
    stream = Stream("tool0", 500.0, Mount(negate=True), 0.05)
    assert came(stream, 3, 2).force_n == ((-3.0, 0.0, 0.0),)


def test_another_frame_from_the_start_is_refused(stream: Stream) -> None:
    with pytest.raises(FrameError):
        came(stream, 1, 2, frame="world")
