"""Hold methods against each other on the tasks of the suite, over several seeds, beside a hand-written rule."""

from __future__ import annotations

import argparse
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from services.rules import command_line
from services.rules.command_line import Parser, whole
from services.rules.shipped_skill import BUILTIN
from services.wire.errors import TreenailError
from services.wire.randomness import MAX_SEED

if TYPE_CHECKING:
    from experiments.lab.progress import Reporter
    from experiments.leaderboard.runner import Spread

PROGRAM = "treenail leaderboard"
OUT = Path("runs", "leaderboard")
MANY_SEEDS = 1000
BOARDS = {
    "transfer": "learn at random starts, freeze, and try at starts, friction, clearance and shapes never seen",
    "long": "long runs, also of tasks that change: is what was learnt kept?",
    "ablation": "the learner with each of its parts left out",
    "rivals": "earlier controllers, of the thesis's chapter 2, and what each was told",
}
ABOUT = """Learning from nothing with noise on, and who does not learn on the same starts beside it. Each run is kept
as it ends, in --out: a second start goes on, several processes may share a folder and the seeds between them, and
--page-only writes the page of what there is."""


def main(words: Sequence[str] | None = None) -> int:
    """Do what the command line (or ``words`` in its place) says and return the exit status."""
    interrupted = "interrupted; started again with the same --out it goes on"
    return command_line.run(PROGRAM, lambda: _act(_parser().parse_args(words)), interrupted=interrupted)


def _act(arguments: argparse.Namespace) -> None:
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    # Loaded here, since every process that works for the board loads this module too.
    from experiments.lab.progress import reporter
    from experiments.leaderboard import boards
    from experiments.leaderboard.folder import Folder

    wanted = boards.Wanted(
        arguments.quick,
        arguments.tasks,
        arguments.methods,
        tuple(arguments.seeds) if arguments.seeds else None,
        arguments.episodes,
        arguments.baseline_episodes,
        tuple(arguments.skill),
        tuple((name, *overrides) for name, *overrides in arguments.variant),
    )
    if arguments.skill and arguments.board is not None:
        raise TreenailError(f"--skill: expected no --{arguments.board} with it, which begins with nothing learnt")
    if arguments.variant and arguments.board in ("ablation", "rivals"):
        raise TreenailError(f"--variant: expected no --{arguments.board} with it, whose methods are others")
    make = boards.BOARDS[arguments.board or "learning"]
    with reporter() as report:
        folder, plan = Folder(arguments.out, report.say), make(wanted)
        spread = None if arguments.page_only else _spread(arguments, report)
        if spread is not None:
            folder.prepare()
        elif folder.empty:
            raise TreenailError(
                f"--page-only: expected a folder with runs of `{PROGRAM}`, got {arguments.out}: none there"
            )
        page, failures = plan(folder, spread, report)
    print(
        f"leaderboard in {page}" + (f"; {failures} runs failed, which a second start tries again" if failures else "")
    )


def _spread(arguments: argparse.Namespace, report: Reporter) -> Spread:
    """Return where the runs are made."""
    from experiments.lab.pool import usable_cores
    from experiments.leaderboard import runner

    if arguments.on is not None:
        return runner.on(arguments.on, report.say)
    return runner.here(arguments.jobs or usable_cores())


def _parser() -> Parser:
    parser = Parser(prog=PROGRAM, description=__doc__, epilog=ABOUT)
    parser.add_argument("--quick", action="store_true", help="minutes: fewer tasks and seeds, short runs")
    which = parser.add_mutually_exclusive_group()
    for board, said in BOARDS.items():
        which.add_argument(f"--{board}", dest="board", action="store_const", const=board, help=said)
    parser.add_argument("--tasks", nargs="+", metavar="NAME", help="only these, such as suite-round or 'suite-*'")
    parser.add_argument("--methods", nargs="+", metavar="NAME", help="only these, and the rule")
    parser.add_argument(
        "--skill",
        nargs="+",
        default=[],
        metavar="FILE",
        help=f"and the learner that begins with this skill; {BUILTIN} is the one that comes with Treenail",
    )
    parser.add_argument(
        "--variant",
        nargs="+",
        action="append",
        default=[],
        metavar=("NAME", "KEY=VALUE"),
        help="and the task's learner with other settings, such as `--variant bold policy.width=2.0`; may be repeated",
    )
    parser.add_argument("--seeds", type=seeds_of, metavar="A..B,C", help="such as 100..109, the default")
    parser.add_argument("--episodes", type=whole(), metavar="N", help="of who learns (default: 300)")
    parser.add_argument("--baseline-episodes", type=whole(), metavar="N", help="of who does not learn (default: 40)")
    parser.add_argument("--out", type=Path, default=OUT, metavar="DIR", help=f"where to write (default: {OUT})")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--jobs", type=whole(), metavar="J", help="processes at a time (default: one per core)")
    where.add_argument("--on", metavar="ADDRESS", help="a Dask cluster's scheduler, such as tcp://10.0.0.5:8786")
    parser.add_argument("--page-only", action="store_true", help="run nothing: the page of what is there")
    return parser


def seeds_of(text: str) -> list[int]:
    """Read seeds such as 100..109,200."""
    seeds = list[int]()
    for part in text.split(","):
        first, dots, last = part.partition("..")
        begin = whole(0, MAX_SEED)(first)
        end = whole(begin, min(begin + MANY_SEEDS - 1, MAX_SEED))(last) if dots else begin
        seeds += range(begin, end + 1)
    if len(set(seeds)) != len(seeds):
        raise argparse.ArgumentTypeError(f"expected every seed once, got {text!r}")
    return seeds


if __name__ == "__main__":
    raise SystemExit(main())
