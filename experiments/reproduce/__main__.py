"""The thesis computed anew, chapter by chapter, as one page: tables and figures with its numbers beside ours."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from services.rules import command_line
from services.rules.command_line import Parser, whole
from services.wire.message_base import LONGEST_RUN

PROGRAM = "treenail reproduce"
SEEDS, QUICK_SEEDS = 10, 2
MAX_SEEDS = 1000


def main(words: Sequence[str] | None = None) -> int:
    """Do what the command line (or ``words`` in its place) says and return the exit status."""
    interrupted = "interrupted; started again with the same --out it resumes"
    typed = sys.argv[1:] if words is None else words
    return command_line.run(PROGRAM, lambda: _act(_parser().parse_args(typed), typed), interrupted=interrupted)


def _act(arguments: argparse.Namespace, words: Sequence[str]) -> None:
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    # Loaded here, since every process that works for the report loads this module too.
    from experiments.reproduce import report

    seeds = arguments.seeds or (QUICK_SEEDS if arguments.quick else SEEDS)
    wanted = report.Wanted(
        arguments.quick,
        tuple(range(seeds)),
        arguments.only,
        arguments.out,
        arguments.data,
        arguments.jobs,
        arguments.episodes,
        arguments.kept,
        arguments.pages,
        tuple(words),
    )
    print(f"report in {report.make(wanted)}", flush=True)


def _parser() -> argparse.ArgumentParser:
    from experiments.reproduce.sections import SECTIONS

    parser, count = Parser(prog=PROGRAM, description=__doc__), whole(1, MAX_SEEDS)
    parser.add_argument("--quick", action="store_true", help="five minutes: few seeds, short runs, rough numbers")
    parser.add_argument(
        "--out", type=Path, default=Path("report"), metavar="DIR", help="where to write (default: report)"
    )
    names = ", ".join(section.name for section in SECTIONS)
    parser.add_argument("--only", nargs="+", metavar="SECTION", help=f"only these of {names} (default: all)")
    parser.add_argument(
        "--seeds",
        type=count,
        metavar="N",
        help=f"run seeds 0 to N-1 (default: {SEEDS}, quick {QUICK_SEEDS})",
    )
    parser.add_argument("--jobs", type=count, metavar="J", help="processes at a time (default: one per core)")
    parser.add_argument(
        "--episodes",
        type=whole(1, LONGEST_RUN),
        metavar="N",
        help="length of the runs of plan, limits and claims (default: 400, 600 and 150)",
    )
    parser.add_argument(
        "--kept", action="store_true", help="plan, limits and claims: no new runs, only what is kept in --out"
    )
    parser.add_argument("--pages", type=Path, metavar="DIR", help="write each section as a Markdown page there, too")
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder with data sets for the sections that need one")
    return parser


if __name__ == "__main__":
    sys.exit(main())
