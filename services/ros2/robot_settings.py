"""The settings of the robot by ROS 2, and its command line. Poses are as `ros2 topic echo` shows them."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass, field

from services.ros2.names import checked_topic
from services.ros2.settings import Graph, graph_of
from services.rules import arm_settings
from services.rules.poses import Pose, from_quaternion
from services.rules.settings import SettingError, add_settings, check, setting, settings_of
from services.wire.text import numbers

_FARTHEST_M, _UNIT = 3.0, 1e-2


@dataclass(frozen=True)
class Settings:
    """What the service is started with."""

    target: str
    """Topic on which the controller takes poses."""
    pose: str
    """Topic on which it reports where the tip is."""
    frame: str
    """Of both."""
    start: Pose | None = None
    """The taught start pose over the hole; None until somebody says."""
    graph: Graph = field(default_factory=Graph)
    start_height_mm: float = arm_settings.start_height_mm()
    withdraw_mm: float = arm_settings.withdraw_mm()
    target_hz: float = setting(100.0, "of targets on the way", within=(1.0, 1000.0))
    stride_mm: float = setting(0.1, "farthest from one target to the next", within=(0.001, 1000.0))
    """With the rate, this is the speed: 10 mm/s as it stands."""
    stride_deg: float = setting(0.1, "farthest turn from one target to the next", within=(0.001, 180.0))
    within_mm: float = arm_settings.within_mm(0.2)
    within_deg: float = arm_settings.within_deg(0.2)
    steady_s: float = setting(
        0.2, "that the reported pose stands still before it counts as arrived", within=(0.0, 10.0)
    )
    """Counted from the last target, too: a controller begins to move a little after it was told."""
    steady_mm: float = setting(0.02, "moved in that time by an arm that stands still", within=(0.0001, 1.0))
    arrive_s: float = setting(30.0, "longest time from the last target to arrival", within=(0.1, 600.0))
    settle_s: float = arm_settings.settle_s(0.05)
    silent_s: float = setting(0.25, "that the controller may report no pose", within=(0.01, 10.0))
    oldest_s: float = arm_settings.oldest_s()
    tell: bool = setting(False, "number each motion, and wait until the controller says that number: the emulated one")
    by_itself: bool = setting(False, "an emulated arm: it moves without `treenail resume`", "--auto-resume")

    def __post_init__(self) -> None:
        """Raise SettingError for what cannot be used."""
        if not self.frame.strip() or len(self.frame) > 200:
            raise SettingError(f"--frame: expected the frame_id of both topics, got {self.frame[:40]!r}")
        if self.target == self.pose:
            raise SettingError(f"--pose: expected another topic than --target, got {self.pose}")
        check(self, SettingError)


def add_arguments(made: argparse.ArgumentParser) -> None:
    """Add the options of the service."""
    made.add_argument("--target", required=True, metavar="TOPIC", help="on which the controller takes poses")
    made.add_argument("--pose", required=True, metavar="TOPIC", help="on which it reports where the tip is")
    made.add_argument("--frame", required=True, metavar="NAME", help="frame_id of both")
    made.add_argument("--start", metavar="X,Y,Z,QX,QY,QZ,QW", help="start pose over the hole, as reported [m]")
    add_settings(made, Graph)
    add_settings(made, Settings)


def settings(arguments: argparse.Namespace) -> Settings:
    """Return the settings in parsed arguments. Raises SettingError, BadNameError."""
    target, pose = checked_topic(arguments.target, "--target"), checked_topic(arguments.pose, "--pose")
    usual = Settings(target, pose, arguments.frame, graph=graph_of(arguments))
    return settings_of(usual, arguments, start=None if arguments.start is None else start_pose(arguments.start))


def start_pose(said: str) -> Pose:
    """Return the pose that `ros2 topic echo` shows as position [m] and orientation. Raises SettingError."""
    try:
        x, y, z, qx, qy, qz, qw = numbers(said, 7)
    except ValueError as error:
        raise SettingError(f"--start: {error}") from None
    length = math.hypot(qx, qy, qz, qw)
    if max(abs(x), abs(y), abs(z)) > _FARTHEST_M or not abs(length - 1.0) <= _UNIT:
        raise SettingError(
            f"--start: expected at most {_FARTHEST_M:g} m, and a quaternion of length 1, got {said[:120]!r}"
        )
    return Pose((1000.0 * x, 1000.0 * y, 1000.0 * z), from_quaternion((qw, qx, qy, qz)))
