"""``python -m services.sim``: one simulator process."""

from __future__ import annotations

import sys

from services.sim.service import serve
from services.wire import command


def main() -> None:
    """Parse the command line and serve."""
    serve(command.options(command.parser("sim", __doc__).parse_args()))


if __name__ == "__main__":
    sys.exit(command.run("sim", main))
