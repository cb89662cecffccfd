"""What would be possible: the best insertions that a search finds with full knowledge of the pose.

Same moves, guidance, limits and reward as a learner has; only the decisions come
from a search (``oracle_search``). The result is a front: the least mean force found for each return. Every entry has
its decisions and can be made again. It is a lower bound of what is possible, and what a learnt policy is held against.
"""

from __future__ import annotations

import argparse
import itertools
import json
import statistics
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, TypedDict

from rich import box
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from experiments.lab import result_files
from experiments.lab.rehearsal import Attempt
from experiments.oracle.search import Advanced, Effort, search
from services.cell.terminal import console, description
from services.rules import command_line, results
from services.rules.command_line import Parser, whole
from services.wire import definition_file
from services.wire.actions import ACTION_NAMES
from services.wire.definition import Definition
from services.wire.errors import TreenailError

PROGRAM = "treenail oracle"
FORCES_N = (0.2, 0.35, 0.5, 1.0)
"""Mean forces for which the best return is told."""
FILE = "oracle.json"
LINE_EVERY_S = 15.0
"""How often a log hears of the search's progress."""
_MATTERS = ("parts", "contact", "wrist", "noise", "start", "hole", "moves", "limits", "reward")
"""The parts of a definition that decide what is possible; the learner's own settings do not."""

Entry = TypedDict(
    "Entry",
    {
        "return": float,
        "mean_force_n": float,
        "peak_force_n": float,
        "moves": int,
        "decisions": int,
        "actions": list[str],
    },
)
"""One insertion; ``actions`` are its decisions in order."""


class Result(TypedDict):
    """The content of ``oracle.json``."""

    experiment: str
    definition_sha256: str
    effort: dict[str, int]
    front: list[Entry]
    """Best return first: the least mean force found for each return."""


class Learnt(NamedTuple):
    """What a run's last quarter gave, as means."""

    seed: str
    episode_return: float
    mean_force_n: float


def main(words: Sequence[str] | None = None) -> int:
    """Do what the command line (or ``words`` in its place) says and return the exit status."""
    return command_line.run(PROGRAM, lambda: _act(_parser().parse_args(words)))


def _act(arguments: argparse.Namespace) -> int:
    definition = definition_file.load(arguments.experiment, arguments.set)
    learnt = learnt_in(arguments.learnt, definition) if arguments.learnt else []
    effort = Effort(arguments.beam, arguments.attempts)
    sha256 = definition_file.definition_sha256(definition)
    if arguments.out:
        result_files.prepare(arguments.out, sha256)
    with _shown() as advanced:
        front = search(definition, effort, advanced)
    if not front:
        raise TreenailError(f"{definition.name}: no insertion found with {effort}")
    result: Result = {
        "experiment": definition.name,
        "definition_sha256": sha256,
        "effort": effort._asdict(),
        "front": [entry(attempt) for attempt in front],
    }
    if arguments.out:
        _write(arguments.out / FILE, result)
    if arguments.json:
        print(json.dumps({**result, "learnt": gaps(result["front"], learnt)}, indent=2))
        return 0
    shown = console()
    shown.print(front_table(result))
    shown.print(limits_table(result["front"]))
    if learnt:
        shown.print(gap_table(result["front"], learnt))
    for index, solution in enumerate(result["front"], start=1):
        shown.print(f"{index}: {short(solution['actions'])}")
    return 0


def entry(attempt: Attempt) -> Entry:
    """Return an attempt as it is reported."""
    done = attempt.summary
    return {
        "return": done.episode_return,
        "mean_force_n": done.mean_force_n,
        "peak_force_n": done.peak_force_n,
        "moves": done.moves,
        "decisions": done.decisions,
        "actions": [ACTION_NAMES[action] for action in attempt.actions],
    }


def best_within(front: Sequence[Entry], force_n: float) -> Entry | None:
    """Return the entry of the best return whose mean force is at most so much [N], None without one."""
    return next((entry for entry in front if entry["mean_force_n"] <= force_n), None)


def least_force(front: Sequence[Entry], episode_return: float) -> Entry | None:
    """Return the entry of the least mean force whose return is at least so good, None without one."""
    good = [entry for entry in front if entry["return"] >= episode_return]
    return min(good, key=lambda entry: entry["mean_force_n"], default=None)


def short(actions: Sequence[str]) -> str:
    """Return decisions as text, repetitions counted, such as ``-X 3*+Z``."""
    groups = ((name, len(list(same))) for name, same in itertools.groupby(actions))
    return " ".join(name if count == 1 else f"{count}*{name}" for name, count in groups)


def learnt_in(folder: Path, definition: Definition) -> list[Learnt]:
    """Return what the runs in a folder of results learnt, a row a seed, and of several their median.

    Raises TreenailError when it cannot be read or its task is not that of ``definition``.
    """
    ran = definition_file.load(str(folder / result_files.DEFINITION))
    for part in _MATTERS:
        if getattr(ran, part) != getattr(definition, part):
            raise TreenailError(f"{folder}: {part}: expected {getattr(definition, part)}, got {getattr(ran, part)}")
    table = result_files.read_episodes(folder / result_files.EPISODES)
    rows = []
    for seed, episodes in table.episodes.items():
        last = results.last_quarter(episodes)
        returns = statistics.fmean(summary.episode_return for summary in last)
        rows.append(Learnt(str(seed), returns, statistics.fmean(summary.mean_force_n for summary in last)))
    if len(rows) > 1:
        median_return = statistics.median(row.episode_return for row in rows)
        rows.append(Learnt("median", median_return, statistics.median(row.mean_force_n for row in rows)))
    return rows


def gaps(front: Sequence[Entry], learnt: Sequence[Learnt]) -> list[dict[str, str | float | None]]:
    """Hold every row of what was learnt against the front: best return at its force, least force at its return."""
    rows: list[dict[str, str | float | None]] = []
    for row in learnt:
        within, least = best_within(front, row.mean_force_n), least_force(front, row.episode_return)
        rows.append(
            {
                **row._asdict(),
                "oracle_return_at_this_force": within["return"] if within else None,
                "oracle_force_n_at_this_return": least["mean_force_n"] if least else None,
            }
        )
    return rows


def front_table(result: Result) -> Table:
    """Return the front as a table."""
    table = _table(f"{result['experiment']}: least mean force found for each return", "")
    for column in ("", "return", "mean force [N]", "peak [N]", "moves", "decisions"):
        table.add_column(column, justify="right")
    for index, entry in enumerate(result["front"], start=1):
        table.add_row(str(index), *_cells(entry))
    return table


def limits_table(front: Sequence[Entry]) -> Table:
    """Return the best insertion below each limit of mean force as a table."""
    table = _table("Best return by mean force", "")
    for column in ("mean force", "return", "mean force [N]", "peak [N]", "moves", "decisions"):
        table.add_column(column, justify="right")
    table.add_row("any", *_cells(front[0]))
    for force_n in reversed(FORCES_N):
        entry = best_within(front, force_n)
        table.add_row(f"<= {force_n:g} N", *(_cells(entry) if entry else ["none found"]))
    return table


def gap_table(front: Sequence[Entry], learnt: Sequence[Learnt]) -> Table:
    """Return what was learnt beside what the oracle found as a table."""
    table = _table("Learnt, and what the oracle found", "learnt: means of the last quarter of all episodes")
    for column in ("seed", "return", "oracle at this force", "force [N]", "oracle at this return [N]"):
        table.add_column(column, justify="right")
    for row in gaps(front, learnt):
        cells = [row["episode_return"], row["oracle_return_at_this_force"]]
        forces = [row["mean_force_n"], row["oracle_force_n_at_this_return"]]
        texts = ["-" if value is None else f"{value:.1f}" for value in cells]
        table.add_row(str(row["seed"]), *texts, *("-" if value is None else f"{value:.3f}" for value in forces))
    return table


def _table(title: str, caption: str) -> Table:
    table = Table(title=title, title_justify="left", caption=caption, caption_justify="left", box=box.SIMPLE_HEAD)
    table.pad_edge = False
    return table


def _cells(entry: Entry) -> list[str]:
    numbers = [f"{entry['return']:.1f}", f"{entry['mean_force_n']:.3f}", f"{entry['peak_force_n']:.2f}"]
    return [*numbers, str(entry["moves"]), str(entry["decisions"])]


def _write(path: Path, result: Result) -> None:
    try:
        path.write_text(json.dumps(result, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise TreenailError(f"{path}: cannot be written: {error.strerror}") from error


@contextmanager
def _shown() -> Iterator[Advanced]:
    """Show progress on stderr: bars in a terminal, else a line now and then."""
    screen = console(stderr=True)
    if not screen.is_terminal:
        yield _lines()
        return
    columns = (description(), BarColumn(), TextColumn("{task.completed}"), TimeElapsedColumn())
    with Progress(*columns, console=screen) as progress:
        tasks = {}

        def advanced(stage: str, done: int, most: int) -> None:
            if stage not in tasks:
                tasks[stage] = progress.add_task(stage, total=most)
            progress.update(tasks[stage], completed=done)

        yield advanced


def _lines() -> Advanced:
    said_s: dict[str, float] = {}

    def advanced(stage: str, done: int, most: int) -> None:
        now_s = time.monotonic()
        if now_s - said_s.get(stage, -LINE_EVERY_S) >= LINE_EVERY_S:
            said_s[stage] = now_s
            print(f"{stage}: {done} of about {most}", file=sys.stderr, flush=True)

    return advanced


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog=PROGRAM, description=__doc__)
    parser.add_argument("experiment", metavar="NAME_OR_FILE", help="a shipped experiment's name, or a TOML file")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="change a setting")
    parser.add_argument("--learnt", type=Path, metavar="DIR", help="results of `treenail experiment run` to compare")
    parser.add_argument("--json", action="store_true", help="print JSON, with every decision")
    parser.add_argument("--out", type=Path, metavar="DIR", help=f"write {FILE} there")
    usual = Effort()
    parser.add_argument(
        "--beam", type=whole(1), default=usual.beam, metavar="N", help=f"beam width per aim (default: {usual.beam})"
    )
    parser.add_argument(
        "--attempts",
        type=whole(0),
        default=usual.attempts,
        metavar="N",
        help=f"most attempts of the local search (default: {usual.attempts})",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
