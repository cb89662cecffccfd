"""One sensor process; --url isa:0x260 for instance."""

from __future__ import annotations

from services.bus import command
from services.sensor_jr3 import settings
from services.sensor_jr3.service import serve


def main() -> None:
    """Parse the command line and serve."""
    parser = command.parser("sensor_jr3", __doc__)
    settings.add_arguments(parser)
    arguments = parser.parse_args()
    serve(command.options(arguments), settings.settings(arguments))


if __name__ == "__main__":
    command.run("sensor_jr3", main)
