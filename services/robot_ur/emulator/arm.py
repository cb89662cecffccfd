"""The arm behind the emulated controller: what moves when a motion is carried out, and what its wrist feels then."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from services.bus.world import Peg, World, WorldFault
from services.robot_ur.emulator.poses import apart, frame, increment_of

NO_LOAD = (0.0,) * 6
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
    def load(self) -> tuple[float, ...]:
        """Force [N] and torque [N m] that the wrist feels, in the tool frame."""
        ...

    def move_to(self, goal: Sequence[float], episode: int | None, step: int | None) -> None:
        """Go to a pose; ``episode`` and ``step`` are what the controller was told. Raises ArmFault."""
        ...

    def stop_at(self, pose: Sequence[float]) -> None:
        """Be stopped on the way, here."""
        ...


class IdealArm:
    """An arm in free space that is always where it should be."""

    def __init__(self, pose: Sequence[float], load: tuple[float, ...] = NO_LOAD) -> None:
        self.pose, self.load = tuple(pose), load

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
        self.pose, self.load = tuple(start), NO_LOAD
        self._world, self._peg = world, Peg(world, start_height_mm)
        self._start = frame(start)

    def move_to(self, goal: Sequence[float], episode: int | None, step: int | None) -> None:
        """See Arm."""
        place = frame(goal)
        away_mm, turned_deg = apart(self._start, place)
        load = NO_LOAD
        if away_mm < _SAME_MM and turned_deg < _SAME_DEG:
            self._peg.leave(at_start=True)
        else:
            try:
                moved = self._peg.step(increment_of(frame(self.pose), place), episode, step)
                if moved is not None:
                    felt = self._world.felt(moved)
                    load = (*felt.force_n[-1], *felt.torque_nm[-1])
            except WorldFault as fault:
                raise ArmFault(str(fault)) from None
        self.pose, self.load = tuple(goal), load

    def stop_at(self, pose: Sequence[float]) -> None:
        """See Arm."""
        self._peg.leave()
        self.pose, self.load = tuple(pose), NO_LOAD
