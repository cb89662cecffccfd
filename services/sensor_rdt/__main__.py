"""One Net F/T, Axia or HEX; --box 192.168.1.1 for instance."""

from __future__ import annotations

from services.bus import command
from services.sensor_rdt import settings
from services.sensor_rdt.service import serve


def main() -> None:
    """Parse the command line and serve."""
    parser = command.parser("sensor_rdt", __doc__)
    settings.add_arguments(parser)
    arguments = parser.parse_args()
    serve(command.options(arguments), settings.settings(arguments))


if __name__ == "__main__":
    command.run("sensor_rdt", main)
