"""``python -m services.sim``: one simulator process."""

from __future__ import annotations

import sys

from services.bus import command
from services.sim.service import serve


def main() -> None:
    """Parse the command line and serve."""
    parser = command.parser("sim", __doc__)
    parser.add_argument("--progress", action="store_true", help="print how the run goes, as `treenail up` does")
    arguments = parser.parse_args()
    serve(command.options(arguments), arguments.progress)


if __name__ == "__main__":
    sys.exit(command.run("sim", main))
