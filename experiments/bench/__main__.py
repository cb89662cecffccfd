"""Measure how fast Treenail is on this machine: medians and spread over several rounds. Nothing is asserted."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from experiments.bench.values import Value, machine
from services.rules import command_line
from services.rules.command_line import Parser, number, whole
from services.wire.definition_file import load
from services.wire.errors import TreenailError
from services.wire.randomness import MAX_SEED

PROGRAM = "treenail bench"
SUMMARIES = {
    "all": "every one of these, short, one after the other: a table, in under ten minutes",
    "loop": "what being distributed costs: physics, a bare Zenoh chain and the real cell, per decision",
    "query": "how long the agent takes to answer while it learns at full speed, and what that costs it",
    "sim": "moves a second: in free air, in contact, in whole episodes",
    "art2": "one classify-and-learn step",
    "env": "steps a second of the Gymnasium environment, beside ManiSkill's and robosuite's where they are installed",
    "classifiers": "all that are installed: speed, agreement with the truth, and what is learnt with them",
    "learner": "updates a second, and one decision",
    "link": "the serial link to the controller without a port: DDCMP messages, moves by dialogue",
    "start": "from `treenail up sim` to its first finished episode",
    "viewer": "memory and processor that the viewer takes beside a cell at full speed, and whether they grow",
    "soak": "a cell at full speed for long: whether memory or store grow, and what an 8 kHz F/T stream beside it loses",
    "cluster": "runs of a leaderboard on a Dask cluster of this machine, with one worker and with two",
    "fleet": "several cells round one router and one store: what each costs, and that none disturbs another",
    "scale": "what many cells over regional routers would send, by calculation from what one cell was measured to",
}
WITH_ROUNDS = ("loop", "query", "sim", "art2", "classifiers", "learner", "link", "start", "cluster", "env")
"""Those that measure everything several times over."""
MOST_MINUTES = 10_000
MOST_CELLS = 64
"""On one machine."""


def main(words: Sequence[str] | None = None) -> int:
    """Do what the command line (or ``words`` in its place) says and return the exit status."""
    return command_line.run(PROGRAM, lambda: _act(_parser().parse_args(words)))


def _act(arguments: argparse.Namespace) -> int:
    if arguments.bench == "all" and arguments.page is not None and not arguments.page.is_dir():
        raise TreenailError(f"--page: expected a folder, got {str(arguments.page)!r}")  # now, not in ten minutes
    report: dict[str, Value] = {"bench": arguments.bench, "machine": machine()}
    results = _measure(arguments)
    report |= {"results": results}
    if arguments.bench == "all" and arguments.page is not None:
        from experiments.bench import page

        page.write(arguments.page, report)
    print(json.dumps(report, indent=2) if arguments.json else _text(report), flush=True)
    return int(results.get("equal") is False)


def _text(report: Mapping[str, Value]) -> str:
    if report["bench"] != "all":
        return "\n".join(lines(report))
    from experiments.bench import every

    return "\n".join(every.lines(report))


def lines(figures: Mapping[str, Value], indent: str = "") -> list[str]:
    """Return a report as text: one line a figure, ``median (min to max)`` where there are several."""
    said: list[str] = []
    width = max((len(name) for name in figures), default=0)
    for name, value in figures.items():
        if isinstance(value, Mapping) and set(value) == {"median", "min", "max"}:
            median, least, most = (_in_words(value[key]) for key in ("median", "min", "max"))
            said.append(f"{indent}{name:<{width}}  {median}  ({least} to {most})")
        elif isinstance(value, Mapping):
            said += [f"{indent}{name}", *lines(value, indent + "  ")]
        elif isinstance(value, Sequence) and not isinstance(value, str):
            for item in value:
                said += lines(item, indent) if isinstance(item, Mapping) else [f"{indent}{name}  {_in_words(item)}"]
                said.append("")
        else:
            said.append(f"{indent}{name:<{width}}  {_in_words(value)}")
    return said


def _in_words(value: Value) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _measure(arguments: argparse.Namespace) -> dict[str, Value]:
    """Carry out what was asked for. Each bench is loaded where it is used: some need libraries that others do not."""
    match arguments.bench:
        case "all":
            from experiments.bench import every

            return every.measure(every.to_stderr)
        case "art2" | "sim" | "learner":
            return _part(arguments)
        case "env":
            from experiments.bench import env

            rounds = arguments.rounds
            return env.measure(arguments.experiment, arguments.set, arguments.steps, arguments.seed, rounds)
        case "link":
            from experiments.bench.link import link

            return link(arguments.messages, arguments.moves, arguments.rounds)
        case "cluster":
            from experiments.bench import cluster

            definition = load(arguments.experiment, arguments.set)
            return cluster.measure(definition, arguments.seed, arguments.runs, arguments.episodes, arguments.rounds)
        case "scale":
            from experiments.bench.message_rates import network, report

            return report(network(arguments))
        case _:
            return _whole(arguments)


def _part(arguments: argparse.Namespace) -> dict[str, Value]:
    """Measure a part of the loop."""
    from experiments.bench import parts

    if arguments.bench == "art2":
        return parts.art2(arguments.steps, arguments.rounds)
    definition = load(arguments.experiment, arguments.set)
    if arguments.bench == "learner":
        return parts.learner(definition, arguments.seed, arguments.steps, arguments.rounds)
    return parts.sim(definition, arguments.seed, arguments.moves, arguments.episodes, arguments.rounds)


def _whole(arguments: argparse.Namespace) -> dict[str, Value]:
    """Measure runs or cells of an experiment."""
    from experiments.bench import classifiers, fleet, loop, query, soak, start, viewer
    from experiments.bench.cell import Subject

    subject = Subject(arguments.experiment, tuple(arguments.set), arguments.seed)
    definition = subject.definition  # what is wrong with it is said before anything starts
    match arguments.bench:
        case "loop":
            kinds = {"secure": arguments.secure, "together": arguments.together}
            return loop.measure(subject, arguments.episodes, arguments.rounds, **kinds)
        case "query":
            return query.measure(subject, arguments.seconds, arguments.rate, arguments.rounds)
        case "classifiers":
            vectors, episodes, rounds = arguments.vectors, arguments.episodes, arguments.rounds
            return classifiers.measure(definition, subject.seed, vectors, episodes, rounds)
        case "start":
            return start.measure(subject, arguments.rounds)
        case "viewer":
            return viewer.measure(subject, 60.0 * arguments.minutes, arguments.memory_limit)
        case "soak":
            return soak.measure(subject, 60.0 * arguments.minutes, arguments.in_packet, arguments.keep_episodes)
        case _:
            return fleet.measure(subject, arguments.cells, arguments.episodes)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog=PROGRAM, description=__doc__)
    commands = parser.add_subparsers(dest="bench", metavar="BENCH", required=True)
    for name, summary in SUMMARIES.items():
        command = commands.add_parser(name, help=summary, description=summary)
        command.add_argument("--json", action="store_true", help="as JSON, units in the names")
        if name in WITH_ROUNDS:
            command.add_argument("--rounds", type=whole(1), default=3, metavar="N", help="repetitions")
        if name not in ("all", "art2", "link", "scale"):
            command.add_argument("--experiment", default="chamfered-q-softmax", help="name or TOML file")
            command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="change a setting")
            command.add_argument("--seed", type=whole(0, MAX_SEED), default=0, help="seed of the run")
    commands.choices["all"].add_argument(
        "--page", type=Path, metavar="FOLDER", help="add to performance.json there, and make performance.md of it"
    )
    loop, sim = commands.choices["loop"], commands.choices["sim"]
    query = commands.choices["query"]
    query.add_argument("--seconds", type=whole(1, 3600), default=5, help="length of each part of a round")
    query.add_argument("--rate", type=whole(1, 1000), default=50, help="questions per second")
    loop.add_argument("--episodes", type=whole(2), default=60, help="length; the first is not counted")
    loop.add_argument("--together", action="store_true", help="measure it with four services in one process as well")
    loop.add_argument("--secure", action="store_true", help="measure the cell with certificates as well")
    sim.add_argument("--episodes", type=whole(1), default=20, help="whole episodes in a round")
    sim.add_argument("--moves", type=whole(1), default=1000, help="moves of one kind in a round")
    several = commands.choices["classifiers"]
    several.add_argument("--vectors", type=whole(10), default=2000, help="recorded vectors in a round")
    several.add_argument("--episodes", type=whole(1), default=100, help="episodes learnt in a round")
    cluster = commands.choices["cluster"]
    cluster.add_argument("--runs", type=whole(1), default=8, help="in a round")
    cluster.add_argument("--episodes", type=whole(1), default=40, help="of each run")
    cluster.set_defaults(experiment="suite-round")
    link = commands.choices["link"]
    link.add_argument("--messages", type=whole(1), default=5000, help="each way in a round")
    link.add_argument("--moves", type=whole(1), default=1000, help="moves by dialogue in a round")
    viewer = commands.choices["viewer"]
    viewer.add_argument("--minutes", type=whole(1, 1440), default=5, metavar="M", help="length")
    viewer.add_argument("--memory-limit", default="256MB", metavar="SIZE", help="the viewer's")
    _add_long_ones(commands.choices)
    for name in ("art2", "learner", "env"):
        commands.choices[name].add_argument(
            "--steps", type=whole(1), default=500 if name == "env" else 5000, help="steps in a round"
        )
    return parser


def _add_long_ones(commands: Mapping[str, argparse.ArgumentParser]) -> None:
    """Add the options of what measures whole cells for long, or calculates with many."""
    from experiments.bench.ft_stream import MOST_IN_A_PACKET, SAMPLES_PER_S
    from experiments.bench.message_rates import add_arguments

    soak, fleet = commands["soak"], commands["fleet"]
    sizes = [size for size in range(1, MOST_IN_A_PACKET + 1) if SAMPLES_PER_S % size == 0]
    soak.add_argument("--minutes", type=number(0.01, MOST_MINUTES, "minutes"), default=30.0, metavar="M", help="length")
    soak.add_argument("--in-packet", type=whole(), choices=sizes, default=8, help="F/T samples in a packet")
    soak.add_argument("--keep-episodes", type=whole(1), default=200, metavar="N", help="that the store keeps")
    fleet.add_argument("--cells", type=_counts, default=(1, 2, 4, 8), metavar="N,...", help="default: 1,2,4,8")
    fleet.add_argument("--episodes", type=whole(2), default=60, help="of each cell")
    add_arguments(commands["scale"])


def _counts(text: str) -> tuple[int, ...]:
    """Return numbers of cells."""
    return tuple(whole(1, MOST_CELLS)(part) for part in text.split(","))


if __name__ == "__main__":
    sys.exit(main())
