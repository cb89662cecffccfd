"""How long work gets on, and what came out of runs, for people at a terminal or reading a log."""

from __future__ import annotations

import math
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol, TextIO, TypeAlias

from rich import box
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from experiments.lab.run import Listener
from services.cell.terminal import console, description
from services.rules.results import STEADY_EPISODES, RunSummary

LINE_EVERY_S = 15.0
"""How often a log hears of each work under way."""

Reach: TypeAlias = Callable[[int], None]
"""Told how much of some work is done, in all; work that has reached its total is over."""


class Reporter(Protocol):
    """Who hears how long work gets on."""

    def say(self, line: str) -> None:
        """Hear something in words."""

    def begin(self, what: str, total: int, unit: str, done: int = 0) -> Reach:
        """Hear that work of ``total`` units begins, ``done`` of them from before; return who is told of more."""


class Bars:
    """A progress bar for each work, in a terminal."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def say(self, line: str) -> None:
        """Print it above the bars."""
        self._progress.console.print(line)

    def begin(self, what: str, total: int, unit: str, done: int = 0) -> Reach:
        """Show a bar."""
        task = self._progress.add_task(what, total=total, completed=done, unit=unit)
        return lambda count: self._progress.update(task, completed=count)


class Lines:
    """Plain lines for a log: when work begins, now and then with the time left, and when it is done."""

    def __init__(self, say: Callable[[str], None], now_s: Callable[[], float]) -> None:
        self.say = say
        self._now_s = now_s

    def begin(self, what: str, total: int, unit: str, done: int = 0) -> Reach:
        """Say so."""
        from_before = f", {done} of them from before" if done else ""
        self.say(f"{what}: {total} {unit}{from_before}")
        began_s = last_s = self._now_s()

        def reach(count: int) -> None:
            nonlocal last_s
            now_s = self._now_s()
            if count == total > done:
                self.say(f"{what}: done in {duration(now_s - began_s)}")
            elif now_s - last_s >= LINE_EVERY_S and count > done:
                last_s = now_s
                left_s = (now_s - began_s) / (count - done) * (total - count)
                self.say(f"{what}: {count} of {total} {unit}, about {duration(left_s)} left")

        return reach


@contextmanager
def reporter(stream: TextIO | None = None) -> Iterator[Reporter]:
    """Show progress on stderr (or ``stream``): bars in a terminal, else lines."""
    stream = stream or sys.stderr
    screen = console(file=stream)
    if not screen.is_terminal:
        yield Lines(lambda line: print(line, file=stream, flush=True), time.monotonic)
        return
    columns = (
        description(),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[unit]}", markup=False),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=screen) as progress:
        yield Bars(progress)


class Runs:
    """Reports the runs of several seeds, each and all together."""

    def __init__(self, reporter: Reporter, seeds: int, episodes: int) -> None:
        self._reporter = reporter
        self._episodes = episodes
        self._reach: dict[int, Reach] = {}
        self._done: dict[int, int] = {}
        self._reach_all = reporter.begin("all", seeds * episodes, "episodes") if seeds > 1 else None

    def started(self, seed: int) -> None:
        """Report a run that begins."""
        self._reach[seed] = self._reporter.begin(f"seed {seed}", self._episodes, "episodes")

    def advanced(self, seed: int, episodes: int) -> None:
        """Report how far a run is."""
        self._done[seed] = episodes
        self._reach[seed](episodes)
        if self._reach_all is not None:
            self._reach_all(sum(self._done.values()))

    def finished(self, seed: int) -> None:
        """Hear that the result is there, too."""


@contextmanager
def of_runs(seeds: int, episodes: int) -> Iterator[Listener]:
    """Show on stderr how the runs of some seeds get on."""
    with reporter() as shown:
        yield Runs(shown, seeds, episodes)


def duration(seconds: float) -> str:
    """Return a length of time in words."""
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def table(title: str, runs: Sequence[RunSummary], moves_per_s: Sequence[float]) -> Table:
    """Return the table of results: a row a seed and, of several, their median. Means are of the last quarter."""
    caption = "return, force and success: means of the last quarter"
    shown = Table(title=title, title_justify="left", caption=caption, caption_justify="left", box=box.SIMPLE_HEAD)
    shown.pad_edge, shown.collapse_padding = False, True  # so that it fits 80 columns
    for column in ("seed", "steady from", "return", "force [N]", "success", "collisions", "states", "moves/s"):
        shown.add_column(column, justify="right")
    rows = [_numbers(run, speed) for run, speed in zip(runs, moves_per_s, strict=True)]
    for run, row in zip(runs, rows, strict=True):
        shown.add_row(str(run["seed"]), *_cells(row, run["episodes"]))
    if len(rows) > 1:
        shown.add_section()
        median = [statistics.median(column) for column in zip(*rows, strict=True)]
        shown.add_row("median", *_cells(median, runs[0]["episodes"]))
    return shown


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
