"""``treenail up ur``: the cell with an arm of Universal Robots, an emulated one or one at an address.

    task -> robot_ur -> RTDE, script, dashboard -> emulated controller -> sim -> its wrist -> RTDE -> robot_ur -> task

Of the emulated one every byte is what goes over a real one's network. The simulator stands in a cell of its own, where
only the emulator meets it, and reads its forces in whole counts as the service does then, so that the run ends in the
same bytes as ``treenail up sim`` with the same definition. A real arm needs no simulator, and gets none.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

from services.bus.ports import free_port
from services.cell import hil
from services.wire.definition import Definition, Sensor
from services.wire.errors import CellError

EMULATED = "emulated"
START_MM = "120.3,-431.7,214.6,2.31,-1.94,0.17"
"""Start pose of the emulated arm: nothing upright or square."""
RATE_HZ = 125
"""Packets a second of the arm unless a definition wants others: what Python beside it keeps up with."""
_PORTS = (29999, 30003, 30004)


@dataclass(frozen=True)
class Ur:
    """One arm. See services.cell.plan.Hardware."""

    address: str
    """Of its controller."""
    emulated: bool
    options: tuple[str, ...]
    """More for ``robot_ur``, as on its command line."""
    sensor: tuple[str, ...] | None = None
    """Options of ``sensor_rdt`` for a box beside the arm; None for the arm's own wrist."""

    @property
    def services(self) -> tuple[str, ...]:
        """See Hardware."""
        return ("robot_ur",) if self.sensor is None else ("robot_ur", "sensor_rdt")

    def overrides(self, definition: Definition) -> Sequence[str]:
        """See Hardware."""
        return hil.for_emulated(definition, "ur --robot emulated", is_arm_rate, RATE_HZ) if self.emulated else ()

    def commands(self, cell: str, endpoint: str, sensor: Sensor) -> dict[str, tuple[str, ...]]:
        """See Hardware: of an emulated arm simulator and emulator, too."""
        here = ("--cell", cell, "--connect", endpoint)
        rate = ("--rate-hz", str(sensor.rate_hz)) if is_arm_rate(sensor.rate_hz) else ()
        robot = (*here, "--robot", self.address, *rate)
        box = {} if self.sensor is None else {"sensor_rdt": (*here, *self.sensor)}
        wrist = () if self.sensor is None else ("--wrist", "none")
        if not self.emulated:
            return {**box, "robot_ur": (*robot, *wrist, *self.options)}
        world = f"{cell}-world"
        emulator = ("--listen", self.address, "--world", world, "--start", START_MM)
        exact = ("--settle-s", "0", "--zero", "never", "--tell-episode", "--auto-resume", "--watchdog-s", "10")
        return {
            "sim": ("--cell", world, "--connect", endpoint),
            "robot_ur.emulator": (*here, *emulator),
            **box,
            "robot_ur": (*robot, "--start", START_MM, "--withdraw-mm", "20", *exact, *wrist, *self.options),
        }


def arm(robot: str = EMULATED, options: Sequence[str] = (), sensor: Sequence[str] | None = None) -> Ur:
    """Return an arm: ``emulated``, on a free address of this machine, or one at an address."""
    box = None if sensor is None else tuple(sensor)
    if robot != EMULATED:
        return Ur(robot, False, tuple(options), box)
    return Ur(_free_address(), True, tuple(options), box)


def is_arm_rate(rate_hz: int) -> bool:
    """Return whether a controller gives so many packets a second."""
    return 10 <= rate_hz <= 500


def _free_address() -> str:
    """Return an address of this machine whose ports for a controller are free. Raises CellError when none is."""
    number = os.getpid()
    for _ in range(100):
        number = (number * 1103515245 + 12345) % 2**24
        address = f"127.{number >> 16 & 255}.{number >> 8 & 255}.{number % 254 + 1}"
        try:
            for port in _PORTS:
                free_port(address, port)
        except OSError:
            continue
        return address
    raise CellError("up ur: expected an address of 127.0.0.0/8 with ports 29999, 30003 and 30004 free, got none")
