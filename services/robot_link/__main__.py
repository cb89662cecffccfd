"""One robot link process; --url socket://127.0.0.1:7000 for instance."""

from __future__ import annotations

from services.bus import command
from services.robot_link import settings
from services.robot_link.channel import Channel, RawChannel
from services.robot_link.ddcmp import supervisory
from services.robot_link.service import serve


def main() -> None:
    """Parse the command line and serve."""
    parser = command.parser("robot_link", __doc__)
    settings.add_arguments(parser)
    supervisory.add_arguments(parser)
    arguments = parser.parse_args()
    channel: Channel = RawChannel()
    if arguments.mode == "supervisory":
        local = arguments.url.startswith("/")
        channel = supervisory.SupervisoryChannel(supervisory.settings_of(arguments, arguments.baud if local else None))
    serve(command.options(arguments), settings.settings(arguments), channel)


if __name__ == "__main__":
    command.run("robot_link", main)
