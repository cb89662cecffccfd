"""One arm of Universal Robots; --robot 192.168.0.10 for instance."""

from __future__ import annotations

from services.bus import command
from services.robot_ur import settings
from services.robot_ur.service import serve


def main() -> None:
    """Parse the command line and serve."""
    parser = command.parser("robot_ur", __doc__)
    settings.add_arguments(parser)
    arguments = parser.parse_args()
    serve(command.options(arguments), settings.settings(arguments))


if __name__ == "__main__":
    command.run("robot_ur", main)
