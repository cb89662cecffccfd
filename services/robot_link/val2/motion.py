"""What to say to the controller for home and moves, and how arrival is confirmed. Pure: scripts of commands and pauses.

A script is a generator: it yields commands and pauses, is sent the controller's lines, and returns when the arm stands
where it should. It raises LinkError when the arm does not, or the controller refused; the arm's place is then unknown.

A motion counts as made when WHERE says so: the pose is within a tolerance of the one it leads to and, where the prompt
may mean no more than "started", two readings one after the other agree. What came before is known from the last WHERE.
"""

from __future__ import annotations

import math
import re
from collections.abc import Generator
from typing import NamedTuple

from services.robot_link.errors import ArrivalError, ControllerError, LinkError, UnsettledError
from services.robot_link.settings import ArmSettings
from services.robot_link.val2 import oat
from services.robot_link.val2.dialects import DIALECTS
from services.robot_link.val2.oat import Convention, Location, Pose
from services.wire.actions import Increment
from services.wire.messages import Home

PROBE = "TNPROB"
"""Location that the probe makes on the controller."""
_WITHDRAW_BY_MM = 10.0
"""DO MOVE interpolates joints, so that its path is bent: of so small a piece by some 0.03 mm."""
_POLL_S = 0.02
_STILL_MM, _STILL_DEG = 0.02, 0.02
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)"
_SIX = re.compile(rf"^\s*(?:[A-Za-z][\w.]*\s*=?\s+)?({_NUMBER}(?:[\s,]+{_NUMBER}){{5}})\s*$", re.ASCII)
_FARTHEST = 1e5


class Command(NamedTuple):
    """Say this, and go on with the lines of the answer."""

    text: str
    reply_s: float | None = None
    """How long the prompt may take; None for as long as usual."""
    may_fail: bool = False
    """Whether a refusal is an answer like others."""


class Pause(NamedTuple):
    """Wait a moment."""

    seconds: float


Script = Generator[Command | Pause, tuple[str, ...], Increment]
Steps = Generator[Command | Pause, tuple[str, ...], None]
_Pose = Generator[Command | Pause, tuple[str, ...], Pose]
_Where = Generator[Command | Pause, tuple[str, ...], Location]


class Arm:
    """One arm behind a terminal: what is known of it, and the scripts that move it."""

    def __init__(self, settings: ArmSettings) -> None:
        self._settings, self._dialect = settings, DIALECTS[settings.dialect]
        self.convention: Convention | None = settings.convention if settings.confirmed else None
        """None until it is settled; nothing moves before."""
        self._pose: Pose | None = None

    def get_ready(self) -> Steps:
        """Stop what may be moving, set the speed, look where the arm is, and settle how O, A, T are meant.

        Nothing in it moves the arm.
        """
        dialect, settings = self._dialect, self._settings
        self._pose = None
        yield Command(dialect.abort, may_fail=dialect.abort_refused_is_fine)
        yield Command(dialect.status, may_fail=True)
        if settings.speed_percent is not None:
            yield from self._quiet(dialect.speed.format(percent=settings.speed_percent))
        here = yield from self._where()
        if not settings.confirmed:
            self.convention = None
            self.convention = yield from self._settle(here)

    def home(self, home: Home) -> Script:
        """Withdraw, go to the taught location and from there to the start pose of an episode."""
        settings = self._settings
        convention = self._sure()
        if settings.withdraw_mm:
            self._pose = oat.pose_of((yield from self._where()), convention)
            pieces = math.ceil(settings.withdraw_mm / _WITHDRAW_BY_MM)
            for _ in range(pieces):
                yield from self._by(Increment(dz_mm=-settings.withdraw_mm / pieces))
        yield from self._to_start(convention)
        if settings.tell_episode:
            yield from self._tell(home.episode, 0)
        z_mm = home.z_mm + settings.start_height_mm
        offset = Increment(home.x_mm, home.y_mm, z_mm, home.rx_deg, home.ry_deg, home.rz_deg)
        yield from self._by(offset)
        return Increment()

    def move(self, increment: Increment, episode: int, step: int) -> Script:
        """Make one increment [mm, deg] in the tool frame; return what was applied."""
        if self._settings.tell_episode:
            yield from self._tell(episode, step)
        applied = yield from self._by(increment)
        return applied

    # -- motions -----------------------------------------------------------------------------------------------------

    def _by(self, increment: Increment) -> Script:
        start, self._pose = self._pose, None
        if start is None:
            raise LinkError("robot: expected to know where the arm is; only home is taken")
        trans, applied = oat.trans_text(increment, self._sure(), self._settings.decimals)
        yield from self._quiet(self._dialect.move_by.format(trans=trans), self._settings.move_s)
        self._pose = yield from self._arrive(oat.after(start, applied))
        return applied

    def _to_start(self, convention: Convention) -> Steps:
        name, dialect = self._settings.start_location, self._dialect
        listed = yield from self._read_location(dialect.list_location.format(location=name))
        self._pose = None
        yield from self._quiet(dialect.move_to.format(location=name), self._settings.move_s)
        self._pose = yield from self._arrive(oat.pose_of(listed, convention))

    def _arrive(self, goal: Pose) -> _Pose:
        settings, convention = self._settings, self._sure()
        before: Pose | None = None
        for _ in range(max(2, round(settings.move_s / _POLL_S))):
            pose = oat.pose_of((yield from self._where()), convention)
            away_mm, turned_deg = oat.apart(pose, goal)
            near = away_mm <= settings.within_mm and turned_deg <= settings.within_deg
            if near and (settings.prompt == "arrived" or (before is not None and _still(before, pose))):
                return pose
            before = pose
            yield Pause(_POLL_S)
        expected = f"within {settings.within_mm:g} mm and {settings.within_deg:g} deg of where the motion leads"
        raise ArrivalError(f"robot: expected the arm {expected}, got {away_mm:.3f} mm and {turned_deg:.3f} deg away")

    # -- single commands ---------------------------------------------------------------------------------------------

    def _settle(self, here: Location) -> Generator[Command | Pause, tuple[str, ...], Convention]:
        dialect = self._dialect
        yield from self._quiet(dialect.probe.format(location=PROBE))
        probe = yield from self._read_location(dialect.list_location.format(location=PROBE))
        convention, told = oat.settled_by(here, probe), self._settings.convention
        if convention is None:
            got = f"{_in_words(probe)} at {_in_words(here)}"
            raise UnsettledError(f"probe: expected HERE:TRANS(0,0,0,0,0,0) to fit one convention of O, A, T, got {got}")
        if told not in (None, convention):
            raise UnsettledError(f"probe: expected the convention {told} that was set, got {convention}")
        return convention

    def _tell(self, episode: int, step: int) -> Steps:
        for variable, value in (("EPISODE", episode), ("STEP", step)):
            yield from self._quiet(self._dialect.assign.format(variable=variable, value=value))

    def _where(self) -> _Where:
        return self._read_location(self._dialect.where)

    def _read_location(self, command: str) -> _Where:
        lines = yield Command(command)
        for line in lines:
            match = _SIX.match(line)
            if match is not None:
                numbers = [float(word) for word in re.split(r"[\s,]+", match.group(1))]
                if max(map(abs, numbers)) <= _FARTHEST:
                    return Location(*numbers)
        raise LinkError(f"{command}: expected a line with X Y Z O A T, got {' / '.join(lines)[:80]!r}")

    def _quiet(self, command: str, reply_s: float | None = None) -> Steps:
        """Give a command that has nothing to say when it is carried out."""
        lines = yield Command(command, reply_s)
        if lines:
            raise ControllerError(f"{command}: expected no more than a prompt, got {' / '.join(lines)[:80]!r}")

    def _sure(self) -> Convention:
        if self.convention is None:
            raise UnsettledError("robot: expected to know how the controller takes O, A, T; see docs/hardware_val2.md")
        return self.convention


def _still(before: Pose, now: Pose) -> bool:
    away_mm, turned_deg = oat.apart(before, now)
    return away_mm <= _STILL_MM and turned_deg <= _STILL_DEG


def _in_words(location: Location) -> str:
    return "(" + ", ".join(f"{value:g}" for value in location) + ")"
