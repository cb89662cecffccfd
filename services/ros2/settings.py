"""The settings that all services of ROS 2 have in common, and their command line."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

from services.ros2.distributions import DISTRIBUTIONS, MOST_DOMAIN, USUAL, Distribution
from services.rules.settings import SettingError, check, setting


@dataclass(frozen=True)
class Graph:
    """Where ROS 2 is, and which."""

    ros: str | None = setting(
        None,
        "of ROS's own router, rmw_zenohd (default: the cell's, see `treenail router --ros2`)",
        metavar="ENDPOINT",
    )
    domain: int = setting(0, "ROS_DOMAIN_ID", within=(0, MOST_DOMAIN))
    distribution: str = setting(
        USUAL, "of ROS 2; jazzy-0.2.3: with rmw_zenoh_cpp of before April 2025", choices=tuple(DISTRIBUTIONS)
    )

    @property
    def chosen(self) -> Distribution:
        """Return the distribution."""
        return DISTRIBUTIONS[self.distribution]

    def check(self) -> None:
        """Raise SettingError for what cannot be used."""
        check(self, SettingError)


def graph_of(arguments: argparse.Namespace) -> Graph:
    """Return what parsed arguments say. Raises SettingError."""
    graph = Graph(arguments.ros, arguments.domain, arguments.distribution)
    graph.check()
    return graph
