"""``treenail up ... --ros2``: the cell as topics of ROS 2; ``treenail up ros2``: an arm of ROS 2, emulated or there.

Without a router of ROS's own, its processes meet the cell's, which lets them speak in their domain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

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
    """An arm behind a Cartesian controller of ROS 2, and its sensor. See services.cell.plan.Hardware.

    task -> ros2_robot -> target_frame -> controller -> current_pose, wrench -> ros2_robot, ros2_sensor

    Where nothing is said, both are emulated, in front of a simulator.
    """

    options: tuple[str, ...] = ()
    """Of ``ros2_robot``, as on its command line; none for the emulated arm."""
    sensor: tuple[str, tuple[str, ...]] = ("ros2_sensor", ())
    """The sensor's service, and its options."""
    graph: Graph = field(default_factory=Graph)
    """Where the arm is."""

    @property
    def emulated(self) -> bool:
        """See Hardware."""
        return not self.options

    @property
    def services(self) -> tuple[str, ...]:
        """See Hardware."""
        return ("ros2_robot", self.sensor[0])

    def overrides(self, definition: Definition) -> Sequence[str]:
        """See Hardware."""
        return hil.for_emulated(definition, "ros2 --robot emulated", is_rate, RATE_HZ) if self.emulated else ()

    def commands(self, cell: str, endpoint: str, sensor: Sensor) -> dict[str, tuple[str, ...]]:
        """See Hardware: with an emulated arm simulator and controller, too."""
        here = ("--cell", cell, "--connect", endpoint)
        name, options = self.sensor
        if not self.emulated:
            there = self.graph.options if name == "ros2_sensor" else ()
            return {name: (*here, *there, *options), "ros2_robot": (*here, *self.graph.options, *self.options)}
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


def is_rate(rate_hz: int) -> bool:
    """Return whether the emulated wrist gives so many samples a second."""
    return 1 <= rate_hz <= 500
