"""The driver of an arm behind topics: targets on a line, arrival from what is reported, and what stops it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import pytest

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")
pytest.importorskip("xxhash", reason="the extra ros2 is not installed")

from services.ros2.motion import Arm, way
from services.ros2.names import Endpoint
from services.ros2.robot_errors import ArrivalError, MotionError
from services.ros2.robot_link import Link, Told
from services.ros2.robot_settings import Settings, start_pose
from services.rules.motions import ArmError
from services.rules.poses import Pose, apart
from services.rules.settings import SettingError
from services.rules.workspace import rotation
from services.wire.actions import Increment
from services.wire.messages import Home

TARGET, POSE = "/c/target_frame", "/c/current_pose"
START = start_pose("0.1203,-0.4317,0.2146,0.7627,-0.6405,0.0561,0.0714")
HOME = Home(run="r", episode=3, x_mm=0.5, y_mm=0.0, z_mm=-5.0, rx_deg=0.0, ry_deg=0.0, rz_deg=0.0)
CONTROLLER = Endpoint("MS", "compliance", TARGET, "geometry_msgs/msg/PoseStamped", "RIHS01_0")


class Bench:
    """A link, and a controller that does what a test says; it is where it should be until then."""

    def __init__(self, **settings: float | bool) -> None:
        usual = {"stride_mm": 1000.0, "stride_deg": 180.0, "target_hz": 1000.0, "steady_s": 0.0, "silent_s": 5.0}
        self.settings = Settings(TARGET, POSE, "base", START, **{**usual, **settings})  # type: ignore[arg-type]
        self.endpoints = [CONTROLLER]
        self.sent: list[tuple[Pose, Told | None]] = []
        self.lost: list[ArmError] = []
        self.results: list[Increment | ArmError] = []
        self.at, self.offset_mm, self.follows = START, 0.0, True
        self.arm = Arm(self.settings)
        self.link = Link(self, self.arm, self.settings, self.lost.append)
        self.until(lambda: self.link.ready)

    def send(self, target: Pose, told: Told | None) -> None:
        self.sent.append((target, told))
        x, y, z = target.position_mm
        if self.follows:
            self.at = Pose((x + self.offset_mm, y, z), target.turn)

    def there(self) -> list[Endpoint]:
        return self.endpoints

    def until(self, holds: Callable[[], object]) -> None:
        deadline = time.monotonic() + 30.0
        while not holds():
            assert time.monotonic() < deadline
            self.link.heard(self.at, time.monotonic())
            self.link.pump(0.001)

    def home(self) -> None:
        self.link.run(self.arm.home(HOME), self.results.append)
        self.until(lambda: self.results)
        assert self.results.pop() == Increment()


def test_home_withdraws_goes_over_the_hole_and_to_where_the_episode_begins() -> None:
    bench = Bench()
    bench.home()
    back, over, begin = (target for target, _ in bench.sent)
    assert apart(back, START.after(Increment(dz_mm=-40.0)))[0] < 1e-9
    assert over == START and begin == START.after(Increment(0.5, 0.0, 15.0))
    bench.link.run(bench.arm.move(Increment(dx_mm=0.1), 3, 1), bench.results.append)
    bench.until(lambda: bench.results)
    assert bench.results == [Increment(dx_mm=0.1)]
    assert bench.sent[-1] == (begin.after(Increment(dx_mm=0.1)), None) and not bench.lost


def test_a_long_way_is_a_row_of_targets_on_a_line_that_turns_evenly() -> None:
    goal = Pose((START.position_mm[0] + 3.0, *START.position_mm[1:]), START.after(Increment(rz_deg=1.0)).turn)
    targets = way(START, goal, 0.5, 90.0)
    assert len(targets) == 6 and targets[-1] == goal
    for number, target in enumerate(targets, 1):
        away_mm, turned_deg = apart(START, target)
        assert math.isclose(away_mm, 0.5 * number, abs_tol=1e-9)
        assert math.isclose(turned_deg, number / 6, abs_tol=1e-6)
    assert len(way(START, goal, 10.0, 0.1)) == 10
    assert way(START, START, 0.1, 0.1) == [START]


def test_what_does_not_arrive_is_told_to_stay_where_it_is() -> None:
    bench = Bench(arrive_s=0.1)
    bench.home()
    bench.offset_mm = 0.5
    bench.link.run(bench.arm.move(Increment(dx_mm=0.1), 3, 1), bench.results.append)
    bench.until(lambda: bench.results)
    (error,) = bench.results
    assert isinstance(error, ArrivalError) and "0.500 mm" in str(error) and bench.lost == [error]
    reached = Pose((bench.sent[-2][0].position_mm[0] + 0.5, *bench.sent[-2][0].position_mm[1:]), bench.at.turn)
    assert bench.sent[-1] == (reached, None)
    with pytest.raises(MotionError, match="only home is taken"):
        next(bench.arm.move(Increment(), 3, 2))


def test_an_arm_that_still_moves_has_not_arrived() -> None:
    bench = Bench(steady_s=0.05, within_mm=5.0, arrive_s=0.5)
    bench.follows = False
    bench.link.run(bench.arm.home(HOME), bench.results.append)
    steps = iter(range(10**6))

    def still_moving() -> bool:
        x, y, z = bench.sent[-1][0].position_mm if bench.sent else START.position_mm
        bench.at = Pose((x + 0.5 * (next(steps) % 2), y, z), START.turn)
        return bool(bench.results)

    bench.until(still_moving)
    assert isinstance(bench.results[0], ArrivalError)


def test_a_controller_that_numbers_motions_is_waited_for() -> None:
    bench = Bench(tell=True)
    bench.link.run(bench.arm.home(HOME), bench.results.append)
    for number, motion in ((1, (-1, -1)), (2, (-1, -1)), (3, (3, 0))):
        bench.until(lambda number=number: len(bench.sent) == number)  # type: ignore[misc]
        assert bench.sent[-1][1] == Told(number, *motion)
        deadline = time.monotonic() + 0.05
        bench.until(lambda deadline=deadline: time.monotonic() > deadline)  # type: ignore[misc]
        assert len(bench.sent) == number and not bench.results, "not made yet"
        bench.link.made(number)
    bench.until(lambda: bench.results)
    assert bench.results == [Increment()]


@pytest.mark.parametrize(
    ("endpoints", "why"),
    [
        ([], "expected a controller that hears /c/target_frame, got none"),
        ([CONTROLLER, CONTROLLER._replace(kind="MP", node="teleop")], "nobody else to publish on /c/target_frame, tel"),
    ],
)
def test_nobody_there_or_somebody_else_ends_a_motion(endpoints: list[Endpoint], why: str) -> None:
    bench = Bench()
    bench.follows = False
    bench.link.run(bench.arm.home(HOME), bench.results.append)
    bench.endpoints = endpoints
    bench.until(lambda: bench.results)
    assert why in str(bench.results[0]) and why in bench.link.trouble
    with pytest.raises(MotionError):
        bench.link.run(bench.arm.home(HOME), bench.results.append)
    bench.endpoints = [CONTROLLER]
    bench.until(lambda: bench.link.ready)


def test_silence_of_the_poses_ends_a_motion() -> None:
    bench = Bench(silent_s=0.05)
    bench.follows = False
    bench.link.run(bench.arm.home(HOME), bench.results.append)
    deadline = time.monotonic() + 30.0
    while not bench.results:
        assert time.monotonic() < deadline
        bench.link.pump(0.001)
    assert "expected poses on /c/current_pose, got none for" in str(bench.results[0])


def test_too_high_a_force_has_the_arm_stay() -> None:
    bench = Bench()
    bench.follows = False
    bench.link.run(bench.arm.home(HOME), bench.results.append)
    bench.until(lambda: bench.sent)
    bench.link.give_up(ArmError("pressing"))
    assert [str(error) for error in bench.results] == ["pressing"]
    assert bench.sent[-1] == (bench.at, None) and not bench.link.busy


def test_an_arm_that_was_moved_by_hand_is_not_called_back_at_once() -> None:
    bench = Bench(stride_mm=1.0)
    bench.home()
    sent = len(bench.sent)
    bench.at = bench.at.after(Increment(dx_mm=50.0))
    bench.link.heard(bench.at, time.monotonic())
    bench.link.run(bench.arm.move(Increment(dx_mm=0.1), 3, 1), bench.results.append)
    (error,) = bench.results
    assert isinstance(error, MotionError) and "somebody moved it" in str(error)
    assert bench.sent[sent:] == [(bench.at, None)], "told to stay there"
    bench.results.clear()
    bench.home()
    assert apart(bench.sent[sent + 1][0], bench.sent[sent][0])[0] <= 1.0 + 1e-9, "home begins where the arm is"


def test_without_a_start_nothing_is_sent() -> None:
    with pytest.raises(MotionError, match="expected --start"):
        Arm(Settings(TARGET, POSE, "base")).home(HOME)


@pytest.mark.parametrize("said", ["0,0,0", "9,0,0,0,0,0,1", "0,0,0,1,1,0,0", "0,0,nan,0,0,0,1"])
def test_what_is_no_start_pose_is_refused(said: str) -> None:
    with pytest.raises(SettingError, match="--start"):
        start_pose(said)


def test_a_start_pose_is_as_ros_shows_it() -> None:
    half = math.sqrt(0.5)
    pose = start_pose(f"0.1,-0.2,0.3,0,0,{half},{half}")
    assert apart(pose, Pose((100.0, -200.0, 300.0), rotation(0.0, 0.0, 90.0)))[0] < 1e-9
    assert apart(pose, Pose((100.0, -200.0, 300.0), rotation(0.0, 0.0, 90.0)))[1] < 1e-9
