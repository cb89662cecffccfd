"""How the runs of an experiment get on, and what came out of them, for people at a terminal or reading a log."""

from __future__ import annotations

import math
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich import box
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from experiments.lab.run import Listener
from services.rules.results import STEADY_EPISODES, RunSummary

LINE_EVERY_S = 15.0
"""How often a log hears of a run's progress."""


class Bars:
    """Progress bars, one a seed and one for all, in a terminal."""

    def __init__(self, progress: Progress, seeds: int, episodes: int) -> None:
        self._progress = progress
        self._episodes = episodes
        self._tasks: dict[int, TaskID] = {}
        self._done: dict[int, int] = {}
        self._all = progress.add_task("all", total=seeds * episodes) if seeds > 1 else None

    def started(self, seed: int) -> None:
        """Show the seed's bar."""
        self._tasks[seed] = self._progress.add_task(f"seed {seed}", total=self._episodes)

    def advanced(self, seed: int, episodes: int) -> None:
        """Move the seed's bar and that of all."""
        self._done[seed] = episodes
        self._progress.update(self._tasks[seed], completed=episodes)
        if self._all is not None:
            self._progress.update(self._all, completed=sum(self._done.values()))

    def finished(self, seed: int) -> None:
        """Leave the full bar standing."""


class Lines:
    """Plain lines for a log: when a seed starts, now and then, and when it is done."""

    def __init__(self, episodes: int, say: Callable[[str], None], now_s: Callable[[], float]) -> None:
        self._episodes = episodes
        self._say = say
        self._now_s = now_s
        self._said_s: dict[int, float] = {}

    def started(self, seed: int) -> None:
        """Say so."""
        self._said_s[seed] = self._now_s()
        self._say(f"seed {seed}: started")

    def advanced(self, seed: int, episodes: int) -> None:
        """Say so when the last line about this seed is some time ago."""
        now_s = self._now_s()
        if now_s - self._said_s[seed] >= LINE_EVERY_S:
            self._said_s[seed] = now_s
            self._say(f"seed {seed}: {episodes} of {self._episodes} episodes")

    def finished(self, seed: int) -> None:
        """Say so."""
        self._say(f"seed {seed}: finished")


@contextmanager
def shown(seeds: int, episodes: int) -> Iterator[Listener]:
    """Show progress on stderr: bars in a terminal, else lines."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield Lines(episodes, lambda line: print(line, file=sys.stderr, flush=True), time.monotonic)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("episodes"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as progress:
        yield Bars(progress, seeds, episodes)


def table(title: str, runs: Sequence[RunSummary], moves_per_s: Sequence[float]) -> Table:
    """Return the table of results: a row a seed and, of several, their median. Means are of the last quarter."""
    caption = "return, force and success: means of the last quarter"
    made = Table(title=title, title_justify="left", caption=caption, caption_justify="left", box=box.SIMPLE_HEAD)
    made.pad_edge, made.collapse_padding = False, True  # so that it fits 80 columns
    for column in ("seed", "steady from", "return", "force [N]", "success", "collisions", "states", "moves/s"):
        made.add_column(column, justify="right")
    rows = [_numbers(run, speed) for run, speed in zip(runs, moves_per_s, strict=True)]
    for run, row in zip(runs, rows, strict=True):
        made.add_row(str(run["seed"]), *_cells(row, run["episodes"]))
    if len(rows) > 1:
        made.add_section()
        median = [statistics.median(column) for column in zip(*rows, strict=True)]
        made.add_row("median", *_cells(median, runs[0]["episodes"]))
    return made


def _numbers(run: RunSummary, moves_per_s: float) -> list[float]:
    steady, last = run["steady_from"], run["last_quarter"]
    return [
        math.inf if steady is None else steady,
        last["return"],
        last["force_n"],
        last["success"],
        run["collisions"],
        run["states"],
        moves_per_s,
    ]


def _cells(row: Sequence[float], episodes: int) -> list[str]:
    steady, reward, force, success, collisions, states, speed = row
    never = "never" if episodes >= STEADY_EPISODES else "-"
    return [
        f"{steady:g}" if math.isfinite(steady) else never,
        f"{reward:.1f}",
        f"{force:.2f}",
        f"{success:.1%}",
        f"{collisions:g}",
        f"{states:g}",
        f"{speed:.0f}",
    ]
