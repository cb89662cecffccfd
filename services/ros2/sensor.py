"""A WrenchStamped topic of ROS 2 as sensor; --topic /fts_broadcaster/wrench --frame tool0 for instance."""

from __future__ import annotations

from services.bus import command
from services.ros2.settings import Graph, graph_of
from services.rules import mount
from services.rules.settings import add_settings, settings_of


def main() -> None:
    """Parse the command line and serve."""
    from services.ros2 import names, sensor_service  # here: a missing extra is one line

    parser = command.parser("ros2_sensor", __doc__)
    parser.add_argument("--topic", required=True, help="full name of the WrenchStamped topic")
    parser.add_argument("--frame", required=True, metavar="NAME", help="frame_id that each sample must have")
    mount.add_arguments(parser, "the frame in the tool's")
    add_settings(parser, Graph)
    add_settings(parser, sensor_service.Settings)
    given = parser.parse_args()
    topic, turned = names.checked_topic(given.topic), mount.parse(given.mount, given.negate)
    usual = sensor_service.Settings(topic, given.frame, graph_of(given))
    sensor_service.serve(command.options(given), settings_of(usual, given, mount=turned))


if __name__ == "__main__":
    command.run("ros2_sensor", main)
