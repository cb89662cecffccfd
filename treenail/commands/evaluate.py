"""``treenail evaluate``: how good a skill is on a task, with the hand-written rule beside it."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from msgspec import to_builtins
from rich import box
from rich.table import Table

from experiments.evaluate.controllers import BASELINES, RULES
from experiments.evaluate.figures import Figures
from experiments.evaluate.run import Method, evaluate
from experiments.lab.pool import usable_cores
from experiments.lab.progress import reporter
from services.cell.terminal import console
from services.rules.command_line import number, whole
from services.rules.shipped_skill import BUILTIN, for_task, named_or_file
from services.wire.definition import Definition
from services.wire.definition_file import load, with_overrides
from services.wire.errors import TreenailError

FIRST_SEED = 1000
OF_A_SKILL = ("learner", "policy", "classifier")
"""Parts of a definition that a skill brings with it."""
"""Seeds of an evaluation begin here, where nobody learns by default."""
ABOUT = f"""Nothing is learnt and nothing tried: the best known move is made. METHOD is a skill's file, {BUILTIN} for
the skill that comes with Treenail, or one of {", ".join(BASELINES)}; the rule is always
among them, on the same starts and with the same noise. In brackets is the 95 percent interval of the success rate
(Wilson). Forces are means over all moves of an episode."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.epilog = ABOUT
    parser.add_argument(
        "method", nargs="+", metavar="METHOD", help=f"a skill's file, {BUILTIN}, {', '.join(BASELINES)}"
    )
    parser.add_argument(
        "--experiment", metavar="NAME_OR_FILE", help="the task (default: the one that the first skill was learnt in)"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change a setting of the task, such as contact.friction=0.6",
    )
    parser.add_argument("--episodes", type=whole(), default=50, metavar="N", help="insertions with each seed")
    parser.add_argument("--seeds", type=whole(), default=3, metavar="K", help=f"seeds from {FIRST_SEED} on")
    parser.add_argument(
        "--moves-per-s", type=number(0.01, 1000), default=5.0, metavar="R", help="motions in a second, for the times"
    )
    parser.add_argument("--jobs", type=whole(), metavar="J", help="processes at a time (default: one per core)")
    parser.add_argument("--json", action="store_true", help="as JSON")


def act(arguments: argparse.Namespace) -> None:
    """Evaluate, and print a row a method."""
    _refuse_what_a_skill_decides(arguments.set)
    methods = [_method(name) for name in dict.fromkeys((*arguments.method, *RULES))]
    definition = _task(arguments, methods)
    # A skill that does not fit is refused before anything runs.
    methods = [
        method if method.skill is None else method._replace(skill=for_task(method.skill, definition))
        for method in methods
    ]
    seeds = range(FIRST_SEED, FIRST_SEED + arguments.seeds)
    total = len(methods) * len(seeds) * arguments.episodes
    done = [0] * (len(methods) * len(seeds))
    with reporter() as report:
        reach = report.begin(f"evaluation on {definition.name}", total, "episodes")

        def advanced(piece: int, episodes: int) -> None:
            done[piece] = episodes
            reach(sum(done))

        jobs = arguments.jobs or usable_cores()
        figures = evaluate(definition, methods, seeds, arguments.episodes, arguments.moves_per_s, jobs, advanced)
        reach(total)
    if arguments.json:
        print(json.dumps({"experiment": definition.name, "methods": figures}))
        return
    console().print(
        table(f"{definition.name}: {arguments.episodes} insertions with each seed of {len(seeds)}", figures)
    )


def table(title: str, figures: dict[str, Figures]) -> Table:
    """Return the figures for people."""
    rich_table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    rich_table.pad_edge, rich_table.collapse_padding = False, True  # so that it fits 80 columns
    headings = ("method", "success [%]", "force [N]", "peak [N]", "moves", "time [s]", "states")
    for heading in headings:
        first = heading == "method"
        rich_table.add_column(heading, justify="left" if first else "right", no_wrap=not first, overflow="fold")
    for name, row in figures.items():
        interval = f"({100 * row['success_low']:.1f} to {100 * row['success_high']:.1f})"
        rich_table.add_row(
            Path(name).name,
            f"{100 * row['success']:.1f} {interval}",
            f"{row['force_n']:.2f}",
            f"{row['peak_force_n']:.2f}",
            f"{row['moves']:.0f}" if row["successes"] else "none",
            f"{row['seconds']:.0f}" if row["successes"] else "none",
            str(row["states"]),
        )
    return rich_table


def _method(name: str) -> Method:
    return Method(name) if name in BASELINES else Method(name, named_or_file(name))


def _refuse_what_a_skill_decides(settings: list[str]) -> None:
    """Raise TreenailError for a setting that would change nothing: learner, classifier and policy are the skill's."""
    for setting in settings:
        key = setting.partition("=")[0].strip()
        if key.partition(".")[0] in OF_A_SKILL:
            raise TreenailError(
                f"--set {key}: expected a setting of the task; {', '.join(OF_A_SKILL)} are what a skill was learnt with"
            )


def _task(arguments: argparse.Namespace, methods: list[Method]) -> Definition:
    """Return the task: the one that is named, else that of the first skill."""
    if arguments.experiment is not None:
        return load(arguments.experiment, arguments.set)
    learnt = [method.skill.skill.definition for method in methods if method.skill is not None]
    if not learnt:
        raise TreenailError("--experiment: expected the name of a task, since none of the methods is a skill")
    return with_overrides(to_builtins(learnt[0]), arguments.set, "--set") if arguments.set else learnt[0]
