"""The thesis computed anew, chapter by chapter, as one page: tables and figures with its numbers beside ours."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from services.bus.command import EXIT_ERROR, Parser
from services.wire.errors import TreenailError

PROGRAM = "treenail reproduce"
EXIT_INTERRUPTED = 130
SEEDS, QUICK_SEEDS = 10, 3
MAX_SEEDS = 1000


def main(words: Sequence[str] | None = None) -> int:
    """Do what the command line (or ``words`` in its place) says and return the exit status."""
    arguments = _parser().parse_args(words)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        # Loaded here, since every process that works for the report loads this module too.
        from experiments.reproduce import report

        seeds = arguments.seeds or (QUICK_SEEDS if arguments.quick else SEEDS)
        wanted = report.Wanted(
            arguments.quick, tuple(range(seeds)), arguments.only, arguments.out, arguments.data, arguments.jobs
        )
        print(f"report in {report.make(wanted)}", flush=True)
        return 0
    except TreenailError as error:
        print(f"{PROGRAM}: {error}", file=sys.stderr)
        return EXIT_ERROR
    except KeyboardInterrupt:
        print(f"{PROGRAM}: interrupted; started again with the same --out it resumes", file=sys.stderr)
        return EXIT_INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog=PROGRAM, description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a few minutes: few seeds, short runs, rough numbers")
    parser.add_argument(
        "--out", type=Path, default=Path("report"), metavar="DIR", help="where to write (default: report)"
    )
    parser.add_argument("--only", nargs="+", metavar="SECTION", help="only these sections (default: all)")
    parser.add_argument(
        "--seeds", type=_count, metavar="N", help=f"run seeds 0 to N-1 (default: {SEEDS}, quick {QUICK_SEEDS})"
    )
    parser.add_argument("--jobs", type=_count, metavar="J", help="processes at a time (default: one per core)")
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder with data sets for the sections that need one")
    return parser


def _count(text: str) -> int:
    try:
        number = int(text)
    except ValueError:
        number = 0
    if not 1 <= number <= MAX_SEEDS:
        raise argparse.ArgumentTypeError(f"expected a whole number from 1 to {MAX_SEEDS}, got {text!r}")
    return number


if __name__ == "__main__":
    sys.exit(main())
