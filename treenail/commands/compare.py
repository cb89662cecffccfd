"""Overlay the curves of any runs, with bands over seeds, and print their figures beside each other."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from services.rules import command_line
from services.rules.command_line import Parser
from services.wire.errors import TreenailError

PROGRAM = "treenail compare"


def main(words: Sequence[str] | None = None) -> int:
    """Do what the command line (or ``words`` in its place) says and return the exit status."""
    return command_line.run(PROGRAM, lambda: _act(_parser().parse_args(words)))


def _act(arguments: argparse.Namespace) -> None:
    from experiments.leaderboard import overlay
    from experiments.leaderboard.board import write
    from services.cell.terminal import console

    picture: Path = arguments.out
    if picture.suffix != ".png":
        raise TreenailError(f"--out: expected the name of a .png file, got {picture}")
    compared = overlay.read(arguments.folder)
    write(picture.parent, {picture.name: overlay.picture(compared)})
    if arguments.json:
        print(json.dumps(overlay.as_json(compared)))
        return
    console().print(overlay.table(compared))
    print(f"curves in {picture}")


def _parser() -> Parser:
    parser = Parser(prog=PROGRAM, description=__doc__)
    parser.add_argument("folder", nargs="+", type=Path, metavar="DIR", help="what `treenail experiment run` wrote")
    parser.add_argument(
        "--out", type=Path, default=Path("compare.png"), metavar="FILE", help="the picture (default: compare.png)"
    )
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
