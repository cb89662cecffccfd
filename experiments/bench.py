"""Measure how fast Treenail is on this machine: medians and spread over several rounds. Nothing is asserted."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence

from experiments.bench_values import Value, machine
from services.wire.command import EXIT_ERROR, Parser
from services.wire.errors import TreenailError
from services.wire.randomness import MAX_SEED

PROGRAM = "treenail bench"
SUMMARIES = {
    "loop": "what being distributed costs: physics, a bare Zenoh chain and the real cell, per decision",
    "query": "how long the agent takes to answer while it learns at full speed, and what that costs it",
    "sim": "moves a second: in free air, in contact, in whole episodes",
    "art2": "one classify-and-learn step",
    "learner": "updates a second, and one decision",
    "start": "from `treenail up sim` to its first finished episode",
    "viewer": "memory and processor that the viewer takes beside a cell at full speed, and whether they grow",
}


def main(words: Sequence[str] | None = None) -> int:
    """Do what the command line (or ``words`` in its place) says and return the exit status."""
    arguments = _parser().parse_args(words)
    try:
        found: dict[str, Value] = {"bench": arguments.bench, "machine": machine()}
        found |= {"results": RUNS[arguments.bench](arguments)}
    except TreenailError as error:
        print(f"{PROGRAM}: {error}", file=sys.stderr)
        return EXIT_ERROR
    except KeyboardInterrupt:
        print(f"{PROGRAM}: interrupted", file=sys.stderr)
        return 130
    try:
        print(json.dumps(found, indent=2) if arguments.json else "\n".join(lines(found)), flush=True)
    except BrokenPipeError:  # whoever reads has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def lines(found: Mapping[str, Value], indent: str = "") -> list[str]:
    """Return a report as text: one line a figure, ``median (min to max)`` where there are several."""
    said: list[str] = []
    width = max((len(name) for name in found), default=0)
    for name, value in found.items():
        if isinstance(value, Mapping) and set(value) == {"median", "min", "max"}:
            median, least, most = (_shown(value[key]) for key in ("median", "min", "max"))
            said.append(f"{indent}{name:<{width}}  {median}  ({least} to {most})")
        elif isinstance(value, Mapping):
            said += [f"{indent}{name}", *lines(value, indent + "  ")]
        elif isinstance(value, Sequence) and not isinstance(value, str):
            for item in value:
                said += lines(item, indent) if isinstance(item, Mapping) else [f"{indent}{name}  {_shown(item)}"]
                said.append("")
        else:
            said.append(f"{indent}{name:<{width}}  {_shown(value)}")
    return said


def _shown(value: Value) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _loop(arguments: argparse.Namespace) -> dict[str, Value]:
    from experiments.bench_loop import Case, measure

    case = Case(arguments.experiment, tuple(arguments.set), arguments.seed, arguments.episodes, arguments.secure)
    return measure(case, arguments.rounds)


def _query(arguments: argparse.Namespace) -> dict[str, Value]:
    from experiments.bench_query import Case, measure

    case = Case(arguments.experiment, tuple(arguments.set), arguments.seed, arguments.seconds, arguments.rate)
    return measure(case, arguments.rounds)


def _sim(arguments: argparse.Namespace) -> dict[str, Value]:
    from experiments.bench_parts import sim
    from services.wire.definition_file import load

    definition = load(arguments.experiment, arguments.set)
    return sim(definition, arguments.seed, arguments.moves, arguments.episodes, arguments.rounds)


def _art2(arguments: argparse.Namespace) -> dict[str, Value]:
    from experiments.bench_parts import art2

    return art2(arguments.steps, arguments.rounds)


def _learner(arguments: argparse.Namespace) -> dict[str, Value]:
    from experiments.bench_parts import learner
    from services.wire.definition_file import load

    return learner(load(arguments.experiment, arguments.set), arguments.seed, arguments.steps, arguments.rounds)


def _start(arguments: argparse.Namespace) -> dict[str, Value]:
    from experiments.bench_start import measure

    return measure(arguments.experiment, tuple(arguments.set), arguments.seed, arguments.rounds)


def _viewer(arguments: argparse.Namespace) -> dict[str, Value]:
    from experiments.bench_viewer import Case, measure

    seconds = 60.0 * arguments.minutes
    return measure(Case(arguments.experiment, tuple(arguments.set), arguments.seed, seconds, arguments.memory_limit))


RUNS: Mapping[str, Callable[[argparse.Namespace], dict[str, Value]]] = {
    "loop": _loop,
    "query": _query,
    "sim": _sim,
    "art2": _art2,
    "learner": _learner,
    "start": _start,
    "viewer": _viewer,
}


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog=PROGRAM, description=__doc__)
    commands = parser.add_subparsers(dest="bench", metavar="BENCH", required=True)
    for name, summary in SUMMARIES.items():
        command = commands.add_parser(name, help=summary, description=summary)
        command.add_argument("--json", action="store_true", help="as JSON, units in the names")
        if name != "viewer":
            command.add_argument("--rounds", type=_from(1), default=3, metavar="N", help="repetitions (default: 3)")
        if name != "art2":
            command.add_argument("--experiment", default="chamfered-q-softmax", help="name or TOML file")
            command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="change a setting")
            command.add_argument("--seed", type=_from(0, MAX_SEED), default=0, help="seed of the run (default: 0)")
    loop, sim = commands.choices["loop"], commands.choices["sim"]
    query = commands.choices["query"]
    query.add_argument("--seconds", type=_from(1, 3600), default=5, help="length of each part of a round (default: 5)")
    query.add_argument("--rate", type=_from(1, 1000), default=50, help="questions per second (default: 50)")
    loop.add_argument("--episodes", type=_from(2), default=60, help="length; the first is not counted (default: 60)")
    loop.add_argument("--secure", action="store_true", help="measure the cell with certificates as well")
    sim.add_argument("--episodes", type=_from(1), default=20, help="whole episodes in a round (default: 20)")
    sim.add_argument("--moves", type=_from(1), default=1000, help="moves of one kind in a round (default: 1000)")
    viewer = commands.choices["viewer"]
    viewer.add_argument("--minutes", type=_from(1, 1440), default=5, metavar="M", help="length (default: 5)")
    viewer.add_argument("--memory-limit", default="256MB", metavar="SIZE", help="the viewer's (default: 256MB)")
    for name in ("art2", "learner"):
        commands.choices[name].add_argument("--steps", type=_from(1), default=5000, help="steps in a round")
    return parser


def _from(least: int, most: int = 10**9) -> Callable[[str], int]:
    """Return a reader of whole numbers from ``least`` to ``most``."""

    def read(text: str) -> int:
        if not (text.isascii() and text.isdigit() and least <= int(text) <= most):
            raise argparse.ArgumentTypeError(f"expected a whole number from {least} to {most}, got {text!r}")
        return int(text)

    return read


if __name__ == "__main__":
    sys.exit(main())
