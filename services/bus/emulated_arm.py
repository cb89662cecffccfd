"""The arm behind an emulated controller: what moves when a motion is carried out, and what its wrist feels then."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from services.bus.follower import loads_of
from services.bus.frames import apart, frame, increment_of
from services.bus.world import Peg, World, WorldFault

Load = tuple[float, ...]
"""Force [N] and torque [N m] that the wrist feels, in the tool frame, shape (6,)."""
NO_LOAD: Load = (0.0,) * 6
_SAME_MM, _SAME_DEG = 1e-6, 1e-6


class ArmFault(Exception):
    """The arm could not carry a motion out."""


class Arm(Protocol):
    """An arm that is somewhere and can be told to go elsewhere. Poses are X, Y, Z [m] and a rotation vector [rad]."""

    @property
    def pose(self) -> tuple[float, ...]:
        """Where the tool is, in the robot's base frame."""
        ...

    @property
    def loads(self) -> tuple[Load, ...]:
        """What the wrist feels, sample after sample, over and over."""
        ...

    def move_to(self, goal: Sequence[float], episode: int | None, step: int | None) -> None:
        """Go to a pose; ``episode`` and ``step`` are what the controller was told. Raises ArmFault."""
        ...

    def stop_at(self, pose: Sequence[float]) -> None:
        """Be stopped on the way, here."""
        ...


class IdealArm:
    """An arm in free space that is always where it should be."""

    def __init__(self, pose: Sequence[float], load: Load = NO_LOAD) -> None:
        self.pose, self.loads = tuple(pose), (load,)

    def move_to(self, goal: Sequence[float], episode: int | None, step: int | None) -> None:
        """See Arm."""
        self.pose = tuple(goal)

    def stop_at(self, pose: Sequence[float]) -> None:
        """See Arm."""
        self.pose = tuple(pose)


class WorldArm:
    """An arm that moves a simulated peg."""

    def __init__(self, world: World, start: Sequence[float], start_height_mm: float) -> None:
        """``start`` is the taught pose over the hole, where the tip is ``start_height_mm`` above the mouth."""
        self.pose = tuple(start)
        self.loads: tuple[Load, ...] = (NO_LOAD,)
        self._world, self._peg = world, Peg(world, start_height_mm)
        self._start = frame(start)

    def move_to(self, goal: Sequence[float], episode: int | None, step: int | None) -> None:
        """See Arm."""
        place = frame(goal)
        away_mm, turned_deg = apart(self._start, place)
        loads: tuple[Load, ...] = (NO_LOAD,)
        if away_mm < _SAME_MM and turned_deg < _SAME_DEG:
            self._peg.leave(at_start=True)
        else:
            try:
                moved = self._peg.step(increment_of(frame(self.pose), place), episode, step)
                if moved is not None:
                    loads = loads_of(self._world.felt(moved))
            except WorldFault as fault:
                raise ArmFault(str(fault)) from None
        self.pose, self.loads = tuple(goal), loads

    def stop_at(self, pose: Sequence[float]) -> None:
        """See Arm."""
        self._peg.leave()
        self.pose, self.loads = tuple(pose), (NO_LOAD,)
