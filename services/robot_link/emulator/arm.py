"""The arm behind the emulated controller: what moves when a motion is carried out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from services.robot_link.emulator.poses import Frame


class ArmFault(Exception):
    """The arm could not carry a motion out; the text is what the controller says."""


class Arm(Protocol):
    """An arm that is somewhere and can be told to go elsewhere. Both motions raise ArmFault."""

    @property
    def place(self) -> Frame:
        """Where the tool is, in the robot's base frame."""
        ...

    def move_by(self, step: Frame, variables: Mapping[str, float]) -> None:
        """Make one step in the tool frame. ``variables`` are those assigned on the controller."""
        ...

    def move_to(self, place: Frame, name: str) -> None:
        """Go to a place; ``name`` is its location's, empty for one without."""
        ...

    def stop_at(self, place: Frame) -> None:
        """Be stopped on the way, here."""
        ...


class IdealArm:
    """An arm in free space that is always where it should be."""

    def __init__(self, place: Frame) -> None:
        self.place = place

    def move_by(self, step: Frame, variables: Mapping[str, float]) -> None:
        """See Arm."""
        self.place = self.place @ step

    def move_to(self, place: Frame, name: str) -> None:
        """See Arm."""
        self.place = place

    def stop_at(self, place: Frame) -> None:
        """See Arm."""
        self.place = place
