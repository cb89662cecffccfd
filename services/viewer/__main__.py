"""Streams a cell to Rerun viewers, on this machine or another."""

from __future__ import annotations

from pathlib import Path

from services.bus import command
from services.rules.command_line import whole


def main() -> None:
    """Parse the command line and serve."""
    from services.viewer.service import Settings, serve  # here: a missing extra is one line

    default = Settings()
    parser = command.parser("viewer", __doc__)
    parser.add_argument("--bind", default=default.bind, metavar="ADDRESS", help="address to listen on")
    parser.add_argument("--port", type=whole(0, 65535), default=default.port, help="0 for any free one")
    parser.add_argument(
        "--memory-limit",
        default=default.memory_limit,
        metavar="SIZE",
        help="how much of the past viewers that attach later get to see",
    )
    parser.add_argument(
        "--save",
        type=Path,
        metavar="FILE",
        help="record to a .rrd file as well; when it is there, to FILE.1.rrd and so on",
    )
    parser.add_argument(
        "--web-port",
        type=whole(0, 65535),
        default=default.web_port,
        metavar="PORT",
        help="port of the page for browsers, 0 for any free one",
    )
    parser.add_argument("--no-web", action="store_true", help="serve no page for browsers")
    chosen = parser.parse_args()
    settings = Settings(
        bind=chosen.bind,
        port=chosen.port,
        memory_limit=chosen.memory_limit,
        save=chosen.save,
        web_port=None if chosen.no_web else chosen.web_port,
    )
    serve(command.options(chosen), settings)


if __name__ == "__main__":
    command.run("viewer", main)
