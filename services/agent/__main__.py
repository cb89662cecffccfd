"""``python -m services.agent``: one agent process."""

from __future__ import annotations

import sys

from services.agent.service import serve
from services.bus import command


def main() -> None:
    """Parse the command line and serve."""
    serve(command.options(command.parser("agent", __doc__).parse_args()))


if __name__ == "__main__":
    sys.exit(command.run("agent", main))
