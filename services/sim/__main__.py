"""One simulator process, in place of robot and sensor."""

from __future__ import annotations

from services.bus import command


def main() -> None:
    """Parse the command line and serve."""
    parser = command.parser("sim", __doc__)
    parser.add_argument("--progress", action="store_true", help="print how the run goes, as treenail up does")
    arguments = parser.parse_args()
    from services.sim.service import serve  # here: what is missing, or Ctrl-C meanwhile, is one line

    serve(command.options(arguments), arguments.progress)


if __name__ == "__main__":
    command.run("sim", main)
