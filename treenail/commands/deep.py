"""Hold deep learners of stable-baselines3 against Treenail's own, on the same starts and with the same noise."""

from __future__ import annotations

import argparse
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from services.rules import command_line
from services.rules.command_line import Parser, whole
from services.wire.errors import TreenailError
from treenail.commands.leaderboard import seeds_of

if TYPE_CHECKING:
    from experiments.deep.plan import Study

PROGRAM = "treenail deep"
OUT = Path("runs", "deep")
TASKS = ["suite-round"]
ABOUT = """DQN, PPO, SAC and RecurrentPPO learn through Treenail's own Gymnasium environment. Each run is kept as it
ends, in --out: a second start goes on with what is missing. Needs what experiments/deep/requirements.txt names."""


def main(words: Sequence[str] | None = None) -> int:
    """Do what the command line (or ``words`` in its place) says and return the exit status."""
    interrupted = "interrupted; started again with the same --out it goes on"
    return command_line.run(PROGRAM, lambda: _act(_parser().parse_args(words)), interrupted=interrupted)


def _act(arguments: argparse.Namespace) -> None:
    from experiments.deep import libraries

    libraries.require()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    from experiments.deep import study
    from experiments.deep.jobs import Environment
    from experiments.lab.pool import usable_cores
    from experiments.lab.progress import reporter
    from treenail.registration import peg_in_hole

    wanted = _study(arguments)
    # Which package the environment is in is known up here alone: studies are below.
    environment = Environment(peg_in_hole, ("treenail.gym",))
    processes = None if arguments.page_only else arguments.jobs or usable_cores()
    with reporter() as report:
        workshop = study.Workshop(arguments.out, environment, processes, report)
        if arguments.tune:
            tried = study.tune(wanted, workshop)
        else:
            made = study.make(wanted, workshop)
            known = study.tune(wanted, workshop._replace(processes=None))
            page = study.tell(wanted, made, known, arguments.page or arguments.out, command(arguments))
    if arguments.tune:
        for one in tried:
            print(f"{one.method.name}: {one.failures:.0%} failures, {one.force_n:.2f} N; {one.method.about}")
    else:
        print(f"deep learners in {page}")


def _study(arguments: argparse.Namespace) -> Study:
    """Return what is asked for. Raises TreenailError."""
    from experiments.deep import plan
    from experiments.deep.methods import methods
    from experiments.leaderboard.suite import tasks

    seeds = tuple(seed for some in arguments.seeds for seed in some) if arguments.seeds else plan.SEEDS
    if len(set(seeds)) != len(seeds):
        raise TreenailError(f"--seeds: expected every seed once, got {' '.join(map(str, seeds))}")
    longer = None
    if arguments.longer:
        name, count = arguments.longer
        try:
            longer = plan.Longer(methods([name])[0], whole()(count))
        except argparse.ArgumentTypeError as error:
            raise TreenailError(f"--longer: {error}") from error
    chosen = methods(arguments.methods)
    return plan.Study(tasks(arguments.tasks), chosen, seeds, arguments.episodes or plan.EPISODES, longer)


def command(arguments: argparse.Namespace) -> str:
    """Return the command line that makes the same page."""
    words = [PROGRAM, "--tasks", *arguments.tasks]
    if arguments.methods:
        words += ["--methods", *arguments.methods]
    if arguments.seeds:
        words += ["--seeds", *(str(seed) for some in arguments.seeds for seed in some)]
    if arguments.episodes:
        words += ["--episodes", str(arguments.episodes)]
    if arguments.longer:
        words += ["--longer", *arguments.longer]
    return " ".join(words + (["--page", str(arguments.page)] if arguments.page else []))


def _parser() -> Parser:
    parser = Parser(prog=PROGRAM, description=__doc__, epilog=ABOUT)
    parser.add_argument(
        "--tasks", nargs="+", default=TASKS, metavar="NAME", help="of the suite, or patterns (default: suite-round)"
    )
    parser.add_argument(
        "--methods", nargs="+", metavar="NAME", help="such as dqn ppo-tuned; Treenail's and the rules are always there"
    )
    parser.add_argument(
        "--seeds", nargs="+", type=seeds_of, metavar="N", help="or ranges, 100..102 (default: 100 101 102)"
    )
    parser.add_argument("--episodes", type=whole(), metavar="N", help="of who learns (default: 300)")
    parser.add_argument(
        "--longer", nargs=2, metavar=("NAME", "N"), help="and this one on the first seed for N episodes"
    )
    parser.add_argument("--out", type=Path, default=OUT, metavar="DIR", help=f"where results are kept (default: {OUT})")
    parser.add_argument(
        "--page", type=Path, metavar="DIR", help="where deep.md, deep.png, deep.json go (default: --out)"
    )
    parser.add_argument("--jobs", type=whole(), metavar="J", help="processes at a time (default: one per core)")
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--tune", action="store_true", help="try settings on seeds of their own, and print what came of them"
    )
    what.add_argument("--page-only", action="store_true", help="run nothing: the page of what is there")
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
