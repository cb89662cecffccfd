"""An emulated arm whose peg meets a simulated hole: its motions are made by a simulator in a cell of its own."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from services.bus.world import Peg, World, WorldFault
from services.robot_link.emulator.arm import ArmFault
from services.robot_link.emulator.poses import Frame, increment_of
from services.wire.actions import Increment


class WorldArm:
    """An arm that moves a simulated peg."""

    def __init__(self, world: World, start: Frame, start_name: str, start_height_mm: float) -> None:
        """``start`` is the taught place over the hole, where the tip is ``start_height_mm`` above the mouth."""
        self.place = start.copy()
        self._peg, self._start_name = Peg(world, start_height_mm), start_name

    def move_by(self, step: Frame, variables: Mapping[str, float]) -> None:
        """See Arm."""
        told = [int(variables[name]) if name in variables else None for name in ("EPISODE", "STEP")]
        try:
            self._peg.step(Increment(*increment_of(step)), *told)
        except WorldFault as fault:
            raise ArmFault(str(fault)) from None
        self.place = self.place @ step

    def move_to(self, place: Frame, name: str) -> None:
        """See Arm."""
        self.place = place
        self._peg.leave(at_start=name == self._start_name)

    def stop_at(self, place: Frame) -> None:
        """See Arm."""
        if not np.array_equal(place, self.place):
            self._peg.leave()
        self.place = place
