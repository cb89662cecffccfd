"""What the arm does for ``home`` and ``move``. Pure: a script asks for steps, and gets what is there then.

home    payload and TCP looked at, once a connection; back along the peg; the start pose, straight; the wrist zeroed
        in the air; one increment to where the episode begins
move    one increment
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from typing import NamedTuple, TypeAlias

from services.robot_ur.errors import PayloadError, StateError
from services.robot_ur.poses import from_ur, to_ur
from services.robot_ur.settings import Settings
from services.robot_ur.states import State
from services.rules.poses import Pose, apart, from_rotation_vector
from services.wire.actions import Increment
from services.wire.messages import Home

GRID = 4
"""Decimals [mm, deg] of what is made and answered."""
PAYLOAD_KG, COG_MM, TCP_MM, TCP_DEG = 0.01, 1.0, 0.05, 0.05
"""How far what the controller has set may be from what was said."""
_GRAVITY = 9.80665


class Look(NamedTuple):
    """Wait for the next packet."""


class Go(NamedTuple):
    """Go straight to a pose, and be there."""

    goal: Pose


class Zero(NamedTuple):
    """Take what the wrist feels now for nothing."""


class Tool(NamedTuple):
    """Ask for the TCP that is set."""


class Tell(NamedTuple):
    """Write which motion of a run follows."""

    episode: int
    step: int


Step: TypeAlias = Look | Go | Zero | Tool | Tell


class Result(NamedTuple):
    """What a step has come to."""

    state: State
    """After it."""
    numbers: Sequence[float] = ()
    """Of ``Tool``: X, Y, Z [m], rotation vector [rad]."""


Script: TypeAlias = Generator[Step, Result, Increment]


class Arm:
    """The scripts of one arm, and where it was led to."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._pose: Pose | None = None
        """None while nobody knows."""
        self._checked = False

    def anew(self) -> None:
        """Forget where the arm is, and what was looked at: the connection is another one."""
        self._pose, self._checked = None, False

    def home(self, home: Home) -> Script:
        """Go to a start pose. The script raises PayloadError. Raises StateError when nobody has said where to start."""
        if self._settings.start is None:
            raise StateError(
                "robot: expected --start, the pose over the hole, got none; bring the arm there with the pendant, "
                "and say what it shows"
            )
        return self._home(home, _pose(self._settings.start))

    def move(self, increment: Increment, episode: int, step: int) -> Script:
        """Make one increment, on the grid."""
        applied = Increment(*(round(value, GRID) + 0.0 for value in increment))
        start, self._pose = self._pose, None
        if start is None:
            raise StateError("robot: expected to know where the arm is; only home is taken")
        if self._settings.tell_episode:
            yield Tell(episode, step)
        goal = start.after(applied)
        yield Go(goal)
        self._pose = goal
        return applied

    def _home(self, home: Home, start: Pose) -> Script:
        settings, self._pose = self._settings, None
        state = (yield Look()).state
        if not self._checked:
            _check_payload(settings, state)
            if settings.tcp is not None:
                _check_tcp(settings.tcp, (yield Tool()).numbers)
            self._checked = True
        if settings.withdraw_mm:
            yield Go(state.pose.after(Increment(dz_mm=-settings.withdraw_mm)))
        yield Go(start)
        if settings.wrist == "tcp":
            _check_air(settings.air_n, (yield Look()).state)
            if settings.zero == "home":
                yield Zero()
        if settings.tell_episode:
            yield Tell(home.episode, 0)
        down_mm = round(home.z_mm + settings.start_height_mm, 9) + 0.0
        goal = start.after(Increment(home.x_mm, home.y_mm, down_mm, home.rx_deg, home.ry_deg, home.rz_deg))
        yield Go(goal)
        self._pose = goal
        return Increment()


def _pose(numbers: Sequence[float]) -> Pose:
    """Return the pose of X, Y, Z [mm] and a rotation vector [rad]."""
    x, y, z, rx, ry, rz = numbers
    return Pose((x, y, z), from_rotation_vector((rx, ry, rz)))


def _check_payload(settings: Settings, state: State) -> None:
    """Raise PayloadError when the controller has another payload than was said."""
    said, has = settings.payload_kg, state.payload_kg
    if said is not None and abs(said - has) > PAYLOAD_KG:
        raise PayloadError(
            f"payload: expected the {said:g} kg of --payload-kg, the controller has {has:g} kg set; weigh what hangs "
            "at the flange and set it there, or say what it has"
        )
    cog = settings.payload_cog_mm
    if cog is not None and math.dist(cog, state.payload_cog_mm) > COG_MM:
        got = ", ".join(f"{value:.1f}" for value in state.payload_cog_mm)
        raise PayloadError(f"payload: expected its centre at --payload-cog-mm {list(cog)}, the controller has {got}")


def _check_tcp(said: Sequence[float], has: Sequence[float]) -> None:
    """Raise PayloadError when the controller has another TCP than was said."""
    away_mm, turned_deg = apart(_pose(said), from_ur(has))
    if away_mm > TCP_MM or turned_deg > TCP_DEG:
        raise PayloadError(
            f"TCP: expected that of --tcp, the controller's is {away_mm:.2f} mm and {turned_deg:.2f} deg away from it: "
            f"{_shown(from_ur(has))}"
        )


def _check_air(most_n: float, state: State) -> None:
    """Raise PayloadError when more is felt in the air than a sensor drifts."""
    force_n = math.hypot(*state.force[:3])
    if force_n > most_n:
        raise PayloadError(
            f"payload: expected at most {most_n:g} N in the air at the start pose (--air-n), got {force_n:.1f} N, the "
            f"weight of {force_n / _GRAVITY:.2f} kg: is the payload right, and is nothing touched?"
        )


def _shown(pose: Pose) -> str:
    x, y, z, rx, ry, rz = to_ur(pose)
    return f"{1000 * x:.2f},{1000 * y:.2f},{1000 * z:.2f},{rx:.4f},{ry:.4f},{rz:.4f}"


def shown(pose: Pose) -> str:
    """Return a pose as the pendant shows it, and as --start takes it."""
    return _shown(pose)
