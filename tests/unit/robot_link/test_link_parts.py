"""The link's own parts: the sensor's clock, the robot's order, a line that comes and goes."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from services.robot_link import link as links
from services.robot_link.channel import RawChannel, Received
from services.robot_link.emulator import poses
from services.robot_link.emulator.arm import IdealArm
from services.robot_link.emulator.controller import Controller
from services.robot_link.emulator.server import Pace
from services.robot_link.errors import LinkError
from services.robot_link.link import Link
from services.robot_link.serial_line import LineError
from services.robot_link.settings import ArmSettings, SettingError
from services.robot_link.val2 import terminal as val2
from services.robot_link.val2.dialects import DIALECTS
from services.robot_link.val2.motion import Arm
from services.robot_link.val2.terminal import Terminal, Timing
from services.rules.arrival import SensorClock
from services.rules.motions import ArmError, GuardError, OtherRunError, OutOfOrderError, Robot
from services.wire.actions import Increment
from services.wire.definition import Definition
from services.wire.messages import FtPacket, Home, Move

MS = 1_000_000
DAY = 1_700_000_000_000 * MS
PLACE = (400.0, 0.0, 100.0, 0.0, 170.0, 0.0)
NONE = ((0.0, 0.0, 0.0),)
GOOD = FtPacket(sequence=1, t_ns=1, force_n=NONE, torque_nm=NONE)


def test_arrival_is_told_in_the_sensors_time() -> None:
    clock = SensorClock()
    for number in range(100):
        # The sensor's clock is an hour ahead; packets take 1 to 20 ms.
        clock.heard(3600_000 * MS + number * MS, number * MS + (1 + number % 20) * MS)
    arrived = clock.arrived(200 * MS, DAY, 5 * MS)
    assert arrived == 3600_000 * MS + (200 - 1 + 5) * MS


def test_the_same_clock_counts_when_it_is_later() -> None:
    clock = SensorClock()
    clock.heard(DAY, 10 * MS)
    assert clock.arrived(20 * MS, DAY + 12 * MS, 0) == DAY + 12 * MS
    assert clock.arrived(20 * MS, DAY + 12 * MS, 0) == DAY + 12 * MS + 1, "never twice the same"


def test_a_sensor_with_another_clock_is_believed_at_once() -> None:
    clock = SensorClock()
    clock.heard(DAY, 0)
    clock.heard(DAY - 3600_000 * MS, 1 * MS)
    assert clock.arrived(2 * MS, 0, 0) == DAY - 3600_000 * MS + 1 * MS


@pytest.mark.parametrize("back_ms", [300, 20_000, 3600_000])
def test_nothing_of_a_clock_that_was_set_back_is_kept(back_ms: int) -> None:
    clock = SensorClock()
    clock.heard(DAY, 10 * MS)
    clock.arrived(11 * MS, 0, 5000 * MS)
    clock.heard(DAY - back_ms * MS, 20 * MS)
    assert clock.arrived(21 * MS, 0, 0) == DAY - back_ms * MS + 1 * MS


def test_packets_that_come_late_do_not_set_the_clock_back() -> None:
    clock = SensorClock()
    for number in range(100):
        clock.heard(DAY + number * MS, number * MS)
    clock.heard(DAY + 100 * MS, 600 * MS)  # half a second late
    assert clock.arrived(600 * MS, 0, 0) == DAY + 600 * MS


def home(robot: Robot, episode: int = 0) -> Home:
    start = Definition(name="any").start
    made = Home(
        run="r",
        episode=episode,
        x_mm=start.x_mm,
        y_mm=start.y_mm,
        z_mm=-start.height_mm,
        rx_deg=start.rx_deg,
        ry_deg=start.ry_deg,
        rz_deg=start.rz_deg,
    )
    robot.home(made)
    robot.homed(made, 1)
    return made


def test_order_guard_and_repetition() -> None:
    robot = Robot(Definition(name="any"), "r", 0.1)
    move = Move(run="r", episode=0, step=1, dx_mm=0.2)
    with pytest.raises(OutOfOrderError, match="not homed"):
        robot.move(move, 0)
    home(robot)
    with pytest.raises(GuardError, match="got none"):
        robot.move(move, 0)
    robot.feel(GOOD, 0)
    with pytest.raises(GuardError, match=r"0.200 s ago"):
        robot.move(move, 200 * MS)
    with pytest.raises(OtherRunError):
        robot.move(Move(run="x", episode=0, step=1), 0)
    robot.move(move, 0)
    done = robot.moved(move, Increment(dx_mm=0.2), 2)
    assert robot.again(move, 0) == done
    with pytest.raises(GuardError):
        robot.again(move, 200 * MS)
    robot.lost()
    assert robot.again(move, 0) is None
    with pytest.raises(OutOfOrderError, match="not homed"):
        robot.move(Move(run="r", episode=0, step=2), 0)


def test_a_motion_asked_for_again_is_answered_in_the_time_of_the_sensor_that_there_is_now() -> None:
    robot = Robot(Definition(name="any"), "r", 0.1)
    home(robot)
    robot.feel(GOOD, 0)
    move = Move(run="r", episode=0, step=1, dx_mm=0.2)
    robot.move(move, 0)
    done = robot.moved(move, Increment(dx_mm=0.2), DAY)
    robot.arrived(7)
    assert robot.again(move, 0) == replace(done, arrived_t_ns=7)


def test_a_force_above_the_hard_limit_stops_a_motion() -> None:
    robot = Robot(Definition(name="any"), "r", 0.1)
    pressed = FtPacket(sequence=1, t_ns=1, force_n=((0.0, 0.0, -19.0), (0.0, 0.0, -21.0)), torque_nm=NONE * 2)
    assert "21.00 N" in (robot.pressing(pressed) or "")
    assert robot.pressing(GOOD) is None


class Torn:
    """A line that cannot be opened at first, and then is torn off."""

    def __init__(self) -> None:
        self.opened = 0

    def open(self) -> None:
        self.opened += 1
        if self.opened < 3:
            raise LineError("line: no such port")

    def read(self, timeout_s: float = 0.0) -> bytes:
        raise LineError("line: lost")

    def write(self, data: bytes) -> None:
        assert data in (b"", b"\r")

    def close(self) -> None:
        """Nothing to close."""


def test_a_line_is_opened_again_and_each_loss_is_told() -> None:
    lost: list[str] = []
    line, arm = Torn(), Arm(ArmSettings())
    link = Link(line, RawChannel(), Terminal(DIALECTS["val2"]), arm.get_ready, lambda error: lost.append(str(error)))
    while len(lost) < 4:
        link.pump(0.01)
    assert lost[0] == "robot: line: no such port"
    assert lost[3] == "robot: line: lost"
    assert not link.ready
    with pytest.raises(LinkError, match="lost"):
        link.run(arm.move(Increment(), 0, 1), lambda _: None)


class Mute:
    """A line whose other end is gone without a word: it opens, swallows what is said, and says nothing."""

    def __init__(self) -> None:
        self.opened = 0

    def open(self) -> None:
        self.opened += 1

    def read(self, timeout_s: float = 0.0) -> bytes:
        return b""

    def write(self, data: bytes) -> None:
        """Swallow it."""

    def close(self) -> None:
        """Nothing to close."""


def test_a_line_that_swallows_everything_is_opened_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(links, "SILENT_S", 0.02)
    monkeypatch.setattr(links, "RETRY_S", (0.0, 0.0))
    lost: list[str] = []
    line = Mute()
    link = Link(
        line, RawChannel(), Terminal(DIALECTS["val2"]), Arm(ArmSettings()).get_ready, lambda e: lost.append(str(e))
    )
    while line.opened < 3:
        link.pump(0.001)
    assert lost[0] == "robot: line: expected the controller to say something within 0.02 s, got nothing"


class Unreachable(Mute):
    """A line that takes as long to open as somebody likes."""

    def __init__(self) -> None:
        super().__init__()
        self.let, self.closed = threading.Event(), threading.Event()

    def open(self) -> None:
        self.let.wait()
        super().open()

    def close(self) -> None:
        self.closed.set()


def test_opening_blocks_nobody_and_is_undone_when_it_comes_too_late() -> None:
    line = Unreachable()
    link = Link(line, RawChannel(), Terminal(DIALECTS["val2"]), Arm(ArmSettings()).get_ready, lambda _: None)
    for _ in range(20):
        link.pump(0.0)
    link.close()
    assert not line.closed.is_set()
    line.let.set()
    assert line.closed.wait(60.0)


class Wire:
    """A line to an emulated controller in this process; ``hear`` changes what comes from it, all in one piece."""

    def __init__(self, hear: Callable[[bytes], bytes]) -> None:
        self.controller, self.hear, self.said = Controller(IdealArm(poses.frame(PLACE, "zyz"))), hear, b""

    def open(self) -> None:
        """Nothing to open."""

    def read(self, timeout_s: float = 0.0) -> bytes:
        now_s = time.monotonic()
        shown = self.controller.receive(self.said, now_s) + self.controller.tick(now_s)
        self.said = b""
        return self.hear(shown)

    def write(self, data: bytes) -> None:
        self.said += data

    def close(self) -> None:
        """Nothing to close."""


def wired(hear: Callable[[bytes], bytes], lost: Callable[[ArmError], None]) -> Link:
    """Return a link that waits for nothing longer than 10 ms."""
    terminal = Terminal(DIALECTS["val2"], Timing(echo_s=0.01, reply_s=0.01, quiet_s=0.0))
    return Link(Wire(hear), RawChannel(), terminal, Arm(ArmSettings()).get_ready, lost)


@pytest.mark.parametrize("behind", [b"nonsense\r\n", b"\r\nPROGRAM COMPLETED\r\n.", b"\x80"])
def test_an_answer_that_more_comes_behind_in_one_piece_is_a_trouble(
    behind: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(links, "RETRY_S", (0.0, 0.0))
    lost: list[str] = []
    added = 0

    def hear(shown: bytes) -> bytes:
        nonlocal added
        if b"\r\n." not in shown or not link.busy or added == 3:
            return shown
        added += 1
        return shown + b"\r\n" + behind

    link = wired(hear, lambda error: lost.append(str(error)))
    while not link.ready:
        link.pump(0.0)
    assert len(lost) == added == 3, lost
    assert all(said.endswith("; told to abort") for said in lost)


@given(
    st.lists(
        st.sampled_from([b"", b"\r\nbad\r\n", b"\r\n.", b"\r\n", b"*bad*", b".", b"X", b"\xff", b"*", b"\x00"]),
        max_size=30,
    )
)
def test_whatever_comes_among_the_answers_no_bytes_crash_the_link(noise: list[bytes]) -> None:
    pieces = iter(noise)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(links, "RETRY_S", (0.0, 0.0))
        patch.setattr(val2, "_KNOCK_EVERY_S", 0.001)
        link = wired(lambda shown: shown + next(pieces, b"") if shown else shown, lambda _: None)
        while not link.ready:
            link.pump(0.0)


def test_a_plain_channel_passes_bytes_on() -> None:
    channel = RawChannel()
    assert not channel.up
    assert channel.start(0.0) == b""
    assert channel.up
    assert channel.send(b"x", 0.0) == b"x"
    assert channel.receive(b"y", 0.0) == Received(b"y")
    assert channel.tick(1.0) == b""


@pytest.mark.parametrize(
    "wrong",
    [
        {"start_location": "treenail"},
        {"speed_percent": 0.0},
        {"within_mm": float("nan")},
        {"decimals": 1},
        {"settle_s": -1.0},
    ],
)
def test_settings_out_of_range_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(SettingError, match="expected"):
        ArmSettings(**wrong)  # type: ignore[arg-type]


def test_bytes_take_their_time_at_9600_baud() -> None:
    pace = Pace(9600)
    pace.put(b"ab", 1.0)
    assert pace.take(1.0) == b""
    assert pace.next_s == pytest.approx(1.0 + 10 / 9600)
    assert pace.take(1.0 + 10.5 / 9600) == b"a"
    assert pace.take(2.0) == b"b"
    assert Pace(None).next_s is None
