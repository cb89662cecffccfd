"""``treenail up ... --ros2``: the cell as topics of ROS 2; ``treenail up ros2``: an emulated arm of ROS 2.

Without a router of ROS's own, its processes meet the cell's, which lets them speak in their domain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from services.cell import hil
from services.wire.definition import Definition, Sensor

OUT = "ros2_out"


@dataclass(frozen=True)
class Graph:
    """Where ROS 2 is, and which."""

    domain: int = 0
    distribution: str | None = None
    """None for the one that the service takes by itself."""
    router: str | None = None
    """Zenoh endpoint of ROS's own; None for the cell's."""

    @property
    def options(self) -> tuple[str, ...]:
        """Return the options of a service of ROS 2."""
        router = () if self.router is None else ("--ros", self.router)
        distribution = () if self.distribution is None else ("--distribution", self.distribution)
        return ("--domain", str(self.domain), *router, *distribution)

    @property
    def of_router(self) -> tuple[str, ...]:
        """Return the options of the cell's router."""
        return () if self.router is not None else ("--ros2", str(self.domain))


EMULATED = "emulated"
START = "0.1203,-0.4317,0.2146,0.7627,-0.6405,0.0561,0.0714"
"""Start pose of the emulated arm: nothing upright or square."""
RATE_HZ = 125
"""Samples a second of its wrist unless a definition wants others."""
_CONTROLLER = ("--target", "/compliance/target_frame", "--pose", "/compliance/current_pose", "--frame", "base_link")


@dataclass(frozen=True)
class RosArm:
    """An emulated arm behind a Cartesian controller of ROS 2, and its sensor.

    task -> ros2_robot -> target_frame -> emulated controller -> sim -> current_pose, wrench -> ros2_robot, ros2_sensor
    """

    emulated: bool = True
    services: tuple[str, ...] = ("ros2_robot", "ros2_sensor")
    """What is in the cell itself."""


def overrides(definition: Definition) -> Sequence[str]:
    """Return what has to be set in a definition for the emulated arm. Raises CellError for what it cannot make."""
    return hil.overrides(definition, "ros2", is_rate, RATE_HZ)


def is_rate(rate_hz: int) -> bool:
    """Return whether the emulated wrist gives so many samples a second."""
    return 1 <= rate_hz <= 500


def commands(cell: str, endpoint: str, sensor: Sensor) -> dict[str, tuple[str, ...]]:
    """Return the options of simulator, emulated controller, sensor and arm, in the order of starting."""
    here = ("--cell", cell, "--connect", endpoint)
    world = f"{cell}-world"
    rate = str(sensor.rate_hz if is_rate(sensor.rate_hz) else RATE_HZ)
    at_once = ("--stride-mm", "1000", "--stride-deg", "180", "--steady-s", "0", "--within-mm", "0.001")
    exact = (*at_once, "--within-deg", "0.001", "--withdraw-mm", "20", "--tell", "--auto-resume")
    return {
        "sim": ("--cell", world, "--connect", endpoint),
        "ros2.emulator": (*here, "--world", world, "--start", START, "--rate-hz", rate),
        "ros2_sensor": (*here, "--topic", "/fts/wrench", "--frame", "tool", "--rate-hz", rate, "--oldest-s", "1"),
        "ros2_robot": (*here, *_CONTROLLER, "--start", START, *exact),
    }
