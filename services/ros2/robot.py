"""An arm behind a Cartesian compliance controller of ROS 2, which takes a target and reports a pose."""

from __future__ import annotations

from services.bus import command


def main() -> None:
    """Parse the command line and serve."""
    from services.ros2 import robot_service, robot_settings  # here: a missing extra is one line

    parser = command.parser("ros2_robot", __doc__)
    robot_settings.add_arguments(parser)
    given = parser.parse_args()
    robot_service.serve(command.options(given), robot_settings.settings(given))


if __name__ == "__main__":
    command.run("ros2_robot", main)
