"""The settings of the sensor by ROS 2, and its command line."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field

from services.ros2.names import checked_topic
from services.ros2.settings import Graph, graph_of
from services.rules import mount
from services.rules.mount import Mount
from services.rules.settings import SettingError, add_settings, check, setting, settings_of

SILENT_S, SILENT_PERIODS = 0.1, 5
"""How long no sample may come: so long, and so many periods."""


@dataclass(frozen=True)
class Settings:
    """What the service is started with."""

    topic: str
    """Full name."""
    frame: str
    """That each sample must be in."""
    graph: Graph = field(default_factory=Graph)
    mount: Mount = field(default_factory=Mount)
    rate_hz: float = setting(500.0, "at which the driver publishes", within=(1.0, 8000.0))
    oldest_s: float = setting(0.05, "how much later than others a sample may come", within=(0.001, 1.0))

    def __post_init__(self) -> None:
        """Raise SettingError for what cannot be used."""
        if not self.frame.strip() or len(self.frame) > 200:
            raise SettingError(f"--frame: expected the frame_id of the samples, got {self.frame[:40]!r}")
        check(self, SettingError)

    @property
    def silent_s(self) -> float:
        """Return how long no sample may come."""
        return max(SILENT_S, SILENT_PERIODS / self.rate_hz)


def add_arguments(made: argparse.ArgumentParser) -> None:
    """Add the options of the service."""
    made.add_argument("--topic", required=True, help="full name of the WrenchStamped topic")
    made.add_argument("--frame", required=True, metavar="NAME", help="frame_id that each sample must have")
    mount.add_arguments(made, "the frame in the tool's")
    add_settings(made, Graph)
    add_settings(made, Settings)


def settings(arguments: argparse.Namespace) -> Settings:
    """Return the settings in parsed arguments. Raises SettingError, BadNameError."""
    usual = Settings(checked_topic(arguments.topic), arguments.frame, graph_of(arguments))
    return settings_of(usual, arguments, mount=mount.parse(arguments.mount, arguments.negate))
