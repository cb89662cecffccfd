"""``treenail up ... --ros2``: the cell as topics of ROS 2.

Without a router of ROS's own, its processes meet the cell's, which lets them speak in their domain.
"""

from __future__ import annotations

from dataclasses import dataclass

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
