"""One simulator process, in place of robot and sensor."""

from __future__ import annotations

from collections.abc import Sequence

from services.bus import command
from services.bus.room import Room


def main(words: Sequence[str] | None = None, room: Room | None = None) -> None:
    """Parse the command line, or other words, and serve, in a process of its own or in a ``room``."""
    parser = command.parser("sim", __doc__)
    parser.add_argument("--progress", action="store_true", help="print how the run goes, as treenail up does")
    arguments = parser.parse_args(words)
    from services.sim.service import serve  # here: what is missing, or Ctrl-C meanwhile, is one line

    serve(command.options(arguments, room), arguments.progress)


if __name__ == "__main__":
    command.run("sim", main)
