"""``python -m services.viewer``: streams a cell to Rerun viewers, on this machine or another."""

from __future__ import annotations

import sys
from pathlib import Path

from services.viewer.service import Settings, serve
from services.wire import command


def main() -> None:
    """Parse the command line and serve."""
    default = Settings()
    parser = command.parser("viewer", __doc__)
    parser.add_argument("--bind", default=default.bind, metavar="ADDRESS", help="address to listen on (default: all)")
    parser.add_argument("--port", type=int, default=default.port, help="0 for any free one (default: 9876)")
    parser.add_argument(
        "--memory-limit",
        default=default.memory_limit,
        metavar="SIZE",
        help="how much of the past viewers that attach later get to see (default: 256MB)",
    )
    parser.add_argument("--save", type=Path, metavar="FILE", help="record to a .rrd file as well")
    chosen = parser.parse_args()
    settings = Settings(bind=chosen.bind, port=chosen.port, memory_limit=chosen.memory_limit, save=chosen.save)
    serve(command.options(chosen), settings)


if __name__ == "__main__":
    sys.exit(command.run("viewer", main))
