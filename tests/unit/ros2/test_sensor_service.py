"""The sensor's shell on a bus in memory: what cannot be believed is told to the robot, and named."""

from __future__ import annotations

import math
import time

import pytest

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")
pytest.importorskip("xxhash", reason="the extra ros2 is not installed")

from services.bus.testing import FakeService
from services.ros2.attachment import Attachment, written
from services.ros2.messages import POSE, WRENCH, Messages, Wrench
from services.ros2.names import topic_key
from services.ros2.node import Node, Sample
from services.ros2.sensor_service import SensorShell
from services.ros2.sensor_settings import Settings
from services.ros2.stream import CHANGED, LOST
from services.wire.messages import FtPacket

TOPIC, GID = "/fts/wrench", bytes(16)
MESSAGES = Messages()
HASH = MESSAGES.type_hash(WRENCH)


class Bench:
    """One sensor, and a driver whose samples are laid out."""

    def __init__(self) -> None:
        self.service = FakeService("ros2_sensor")
        self.service.claim()
        node = Node(self.service.session, 0, "sensor", MESSAGES)
        self.shell = SensorShell(self.service, Settings(TOPIC, "fts"), node)
        self._start_ns = time.time_ns()
        self._number = 0
        self.gid = GID

    def sample(
        self, frame: str = "fts", x: float = 1.0, kind: str = WRENCH, type_hash: str = HASH, jump_s: float = 0.0
    ) -> list[FtPacket]:
        """Let the next sample come, 2 ms after the one before; return what is published of it."""
        self._number += 1
        passed_ns = 2_000_000 * self._number
        stamp_ns = self._start_ns + passed_ns + round(jump_s * 1e9)
        data = MESSAGES.wrench(Wrench(stamp_ns, frame, (x, 0.0, 0.0), (0.0, 0.0, 0.0)))
        attached = written(Attachment(self._number, stamp_ns, self.gid), MESSAGES.distribution)
        before = len(self.service.published(FtPacket))
        self.shell.take(Sample(topic_key(0, TOPIC, kind, type_hash), data, attached, passed_ns))
        return self.service.published(FtPacket)[before:]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_samples_become_packets(bench: Bench) -> None:
    (first,), (second,) = bench.sample(x=1.0), bench.sample(x=2.0)
    assert (first.status, first.force_n, second.force_n) == (0, ((1.0, 0.0, 0.0),), ((2.0, 0.0, 0.0),))
    assert second.sequence == first.sequence + 1 and second.t_ns > first.t_ns
    assert bench.service.phase == "running" and not bench.service.refused


@pytest.mark.parametrize(
    ("wrong", "status", "error"),
    [
        ({"x": math.nan}, LOST, "MessageError"),
        ({"frame": "base"}, LOST, "FrameError"),
        ({"jump_s": -5.0}, CHANGED, "ClockError"),
        ({"jump_s": 5.0}, CHANGED, "ClockError"),
    ],
)
def test_a_sensor_that_cannot_be_believed_is_told_at_once(
    bench: Bench, wrong: dict[str, object], status: int, error: str
) -> None:
    bench.sample()
    (told,) = bench.sample(**wrong)  # type: ignore[arg-type]
    assert (told.status, told.force_n) == (status, ((1.0, 0.0, 0.0),))
    assert bench.service.refused == {error: 1}
    (good,) = bench.sample(x=3.0)
    assert good.status == 0 and good.sequence > told.sequence and good.t_ns > told.t_ns


@pytest.mark.parametrize(
    "wrong", [{"type_hash": "TypeHashNotSupported"}, {"type_hash": HASH[:-1] + "0"}, {"kind": POSE}]
)
def test_what_is_of_another_kind_is_not_read(bench: Bench, wrong: dict[str, str]) -> None:
    bench.sample()
    assert bench.sample(**wrong) == []  # type: ignore[arg-type]
    assert bench.service.refused == {"PeerError": 1}


def test_silence_is_told(bench: Bench) -> None:
    bench.sample()
    before = len(bench.service.published(FtPacket))
    bench.shell.watch(time.monotonic() + 1.0)
    told = bench.service.published(FtPacket)[before:]
    assert {packet.status for packet in told} == {LOST}, "and again when it was looked who is there"


def test_another_publisher_after_a_silence_is_told_before_its_samples(bench: Bench) -> None:
    bench.sample()
    bench.shell.watch(time.monotonic() + 1.0)
    (same,) = bench.sample()
    assert same.status == 0, "it was silent, and is the same"
    bench.shell.watch(time.monotonic() + 1.0)
    bench.gid = b"another".ljust(16)
    changed, good = bench.sample(x=2.0)
    assert (changed.status, good.status) == (CHANGED, 0)
    assert good.sequence > changed.sequence and good.t_ns > changed.t_ns
    assert [packet.status for packet in bench.sample()] == [0]
