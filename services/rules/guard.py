"""The guard beside the robot: the last thing before a motion, for ``sim`` and ``robot_link`` alike. Pure.

It needs no learner, no task and no network: whoever asks for a motion, it is made only inside these limits.

    sensor      a usable F/T sample, not older than a set time
    steps       each component within the experiment's action set, no more motions than an episode may have
    workspace   how deep, how far from the start and how far turned one episode may take the arm
    force       no motion after a collision; what is felt and what the motion can add stay within the hard limit

How to call it: before ``home``, ``homing``; before a motion, ``moving`` with the newest sample and its age. What comes
back is the reason not to move, or None. Afterwards ``homed``, or ``moved`` with what was really applied.

An age is told in seconds of a clock that both its ends were read from. For a real sensor that is the monotonic clock of
the guard's own process, from the sample's arrival to now, so that no two clocks need agree; the simulator's time is
simulated. A robot link has its own subscription to ``ft`` for this, and asks ``sensing`` in its loop as well, to say
that it stands and why. All motions are single increments: a sensor lost in one stops the arm before the next, and a
guard that is dead commands nothing.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import chain

from services.rules.bounds import Bounds
from services.rules.window import unusable
from services.rules.workspace import Workspace
from services.wire.actions import Increment, extremes, guidance, increments
from services.wire.definition import Definition
from services.wire.force_bound import ForceBound
from services.wire.messages import FtPacket, Home, Move, Moved

OLDEST_S = 0.1
"""Age of an F/T sample above which it says nothing about now, unless the guard is told another."""
_ROUNDING = 1e-9
_ONLY_HOME = "only home is taken"


class Guard:
    """The limits of one experiment, and where the arm was commanded to since the last ``home``."""

    def __init__(self, definition: Definition, oldest_s: float = OLDEST_S) -> None:
        """Take the limits from a definition; an F/T sample may be ``oldest_s`` seconds old."""
        start, moves, limits = definition.start, definition.moves, definition.limits
        x_mm, y_mm, rx_deg, ry_deg, rz_deg = start.spreads
        self._starts = {
            "x_mm": (start.x_mm - x_mm, start.x_mm + x_mm),
            "y_mm": (start.y_mm - y_mm, start.y_mm + y_mm),
            "z_mm": (-start.height_mm, -start.height_mm),
            "rx_deg": (start.rx_deg - rx_deg, start.rx_deg + rx_deg),
            "ry_deg": (start.ry_deg - ry_deg, start.ry_deg + ry_deg),
            "rz_deg": (start.rz_deg - rz_deg, start.rz_deg + rz_deg),
        }
        self._steps = {
            name: (min(0.0, *values), max(0.0, *values))
            for name, values in zip(Increment._fields, zip(*extremes(moves), strict=True), strict=True)
        }
        self._listed = (*increments(moves), guidance(moves)) if moves.list else ()
        self._bounds = Bounds(definition)
        self._oldest_s = oldest_s
        self._most_steps = limits.move_limit
        self._collision_force_n, self._hard_force_n = limits.collision_force_n, limits.hard_force_n
        bound = ForceBound(definition)
        self._most_n = bound.largest_n
        # An experiment has a handful of moves, and each is asked for thousands of times.
        self._added_n = lru_cache(maxsize=64)(bound.added_n)
        self._workspace = Workspace(definition)

    def homing(self, home: Home) -> str | None:
        """Return why a start pose is refused, or None: only those that the experiment begins episodes with are taken.

        It is the way out of everything else, so it needs neither a sensor nor a low force.
        """
        return _outside(home, self._starts)

    def homed(self, home: Home) -> None:
        """Take note that the arm stands at a start pose."""
        self._workspace.begin(home.z_mm)

    def moving(self, move: Move, felt: FtPacket | None, age_s: float) -> str | None:
        """Return why a motion is refused, or None. ``felt``: the newest F/T sample, ``age_s`` seconds old."""
        complaint = self.sensing(felt, age_s) or _outside(move, self._steps)
        if complaint is not None or felt is None:
            return complaint
        if move.step > self._most_steps:
            return f"guard: step: expected at most {self._most_steps} motions since home, got {move.step}; {_ONLY_HOME}"
        increment = increment_of(move)
        if self._listed and not self._bounds.hold(increment) and self._apart(increment) > _ROUNDING:
            return f"guard: move: expected one of moves.list or a step of guidance, got {tuple(increment)}"
        return self._workspace.complaint(increment) or self._pressing(math.hypot(*felt.force_n[-1]), increment)

    def moved(self, applied: Increment) -> None:
        """Take note of what was really applied."""
        self._workspace.take(applied)

    def sensing(self, felt: FtPacket | None, age_s: float) -> str | None:
        """Return why nothing may move with this F/T sample, or None."""
        if felt is None:
            return f"guard: sensor: expected an F/T sample, got none; {_ONLY_HOME}"
        if not 0.0 <= age_s <= self._oldest_s:  # an age that is no number never passes
            expected = f"expected an F/T sample of 0 to {self._oldest_s} s ago"
            return f"guard: sensor: {expected}, got one of {age_s:.3f} s ago; {_ONLY_HOME}"
        why = unusable(felt.status)
        if why is not None:
            return f"guard: sensor: expected a usable F/T sample, got status {felt.status} ({why}); {_ONLY_HOME}"
        if not all(map(math.isfinite, chain(*felt.force_n, *felt.torque_nm))):
            got = f"{felt.force_n[-1]} N and {felt.torque_nm[-1]} N m"
            return f"guard: sensor: expected a finite force and torque, got {got}; {_ONLY_HOME}"
        return None

    def _apart(self, increment: Increment) -> float:
        """Return how far a motion is from the nearest of the list."""
        return min(math.dist(increment, listed) for listed in self._listed)

    def _pressing(self, force_n: float, increment: Increment) -> str | None:
        """Return why a motion is refused after a force of this magnitude, or None."""
        if force_n >= self._collision_force_n:
            expected = f"expected less than the {self._collision_force_n} N of a collision"
            return f"guard: force: {expected}, got {force_n:.2f} N; {_ONLY_HOME}"
        added_n, most_n = self._added_n(increment), self._most_n
        if added_n > most_n + _ROUNDING:
            return f"guard: size: expected at most the {most_n:.2f} N that one action can add, got {added_n:.2f} N"
        if force_n + added_n > self._hard_force_n:
            got = f"{force_n:.2f} N and {added_n:.2f} N that this motion can add"
            return f"guard: force: expected at most {self._hard_force_n} N after the motion, got {got}"
        return None


def increment_of(message: Move | Moved) -> Increment:
    """Return the motion in a request or in its reply."""
    return Increment(message.dx_mm, message.dy_mm, message.dz_mm, message.rx_deg, message.ry_deg, message.rz_deg)


def _outside(message: Home | Move, ranges: dict[str, tuple[float, float]]) -> str | None:
    """Return which component lies outside its range, or None."""
    for name, (low, high) in ranges.items():
        value = getattr(message, name)
        if not low - _ROUNDING <= value <= high + _ROUNDING:  # what is no number never passes
            return f"guard: {name}: expected {low} to {high}, got {value}"
    return None
