"""Streams a cell to Rerun viewers, on this machine or another."""

from __future__ import annotations

from services.bus import command
from services.rules.settings import add_settings, settings_of


def main() -> None:
    """Parse the command line and serve."""
    from services.viewer.service import Settings, serve  # here: a missing extra is one line

    parser = command.parser("viewer", __doc__)
    add_settings(parser, Settings)
    parser.add_argument("--no-web", action="store_true", help="serve no page for browsers")
    chosen = parser.parse_args()
    settings = settings_of(Settings(), chosen, **({"web_port": None} if chosen.no_web else {}))
    serve(command.options(chosen), settings)


if __name__ == "__main__":
    command.run("viewer", main)
