"""A WrenchStamped topic of ROS 2 as sensor; --topic /fts_broadcaster/wrench --frame tool0 for instance."""

from __future__ import annotations

from services.bus import command


def main() -> None:
    """Parse the command line and serve."""
    from services.ros2 import sensor_service, sensor_settings  # here: a missing extra is one line

    parser = command.parser("ros2_sensor", __doc__)
    sensor_settings.add_arguments(parser)
    given = parser.parse_args()
    sensor_service.serve(command.options(given), sensor_settings.settings(given))


if __name__ == "__main__":
    command.run("ros2_sensor", main)
