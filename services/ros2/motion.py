"""What an arm of ROS 2 does for ``home`` and ``move``, and the targets on its way. Pure.

home    back along the peg; the start pose, straight; one increment to where the episode begins
move    one increment
"""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import NamedTuple, TypeAlias

from services.ros2.robot_errors import MotionError
from services.ros2.robot_settings import Settings
from services.rules.poses import Pose, apart, from_rotation_vector, rotation_vector
from services.rules.workspace import product
from services.wire.actions import Increment
from services.wire.messages import Home

GRID = 4
"""Decimals [mm, deg] of what is made and answered."""


class Go(NamedTuple):
    """Go straight to a pose, and be there; None for where the arm is."""

    goal: Pose | None
    motion: tuple[int, int] | None = None
    """Episode and step that this is, told to who asks for it."""


Script: TypeAlias = Generator[Go, Pose, Increment]
"""Is given the pose that the arm reports after each step."""


class Arm:
    """The scripts of one arm, and where it was led to."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._pose: Pose | None = None
        """None while nobody knows."""

    def anew(self) -> None:
        """Forget where the arm is."""
        self._pose = None

    def home(self, home: Home) -> Script:
        """Go to a start pose. Raises MotionError when nobody has said where to start."""
        start = self._settings.start
        if start is None:
            raise MotionError(
                f"robot: expected --start, the pose over the hole, got none; bring the arm there and say what "
                f"{self._settings.pose} shows"
            )
        return self._home(home, start)

    def move(self, increment: Increment, episode: int, step: int) -> Script:
        """Make one increment, on the grid."""
        applied = Increment(*(round(value, GRID) + 0.0 for value in increment))
        start, self._pose = self._pose, None
        if start is None:
            raise MotionError("robot: expected to know where the arm is; only home is taken")
        goal = start.after(applied)
        yield Go(goal, (episode, step))
        self._pose = goal
        return applied

    def _home(self, home: Home, start: Pose) -> Script:
        settings, self._pose = self._settings, None
        at = yield Go(None)
        if settings.withdraw_mm:
            yield Go(at.after(Increment(dz_mm=-settings.withdraw_mm)))
        yield Go(start)
        down_mm = round(home.z_mm + settings.start_height_mm, 9) + 0.0
        goal = start.after(Increment(home.x_mm, home.y_mm, down_mm, home.rx_deg, home.ry_deg, home.rz_deg))
        yield Go(goal, (home.episode, 0))
        self._pose = goal
        return Increment()


def way(start: Pose, goal: Pose, stride_mm: float, stride_deg: float) -> list[Pose]:
    """Return the targets from one pose to another, the goal last: on a line, turning evenly about one axis."""
    away_mm, turned_deg = apart(start, goal)
    count = max(1, math.ceil(away_mm / stride_mm - 1e-9), math.ceil(turned_deg / stride_deg - 1e-9))
    back = tuple(zip(*start.turn, strict=True))
    turn = rotation_vector(product((back[0], back[1], back[2]), goal.turn))
    targets: list[Pose] = []
    for number in range(1, count):
        part = number / count
        x, y, z = (a + part * (b - a) for a, b in zip(start.position_mm, goal.position_mm, strict=True))
        rx, ry, rz = (part * value for value in turn)
        targets.append(Pose((x, y, z), product(start.turn, from_rotation_vector((rx, ry, rz)))))
    return [*targets, goal]
