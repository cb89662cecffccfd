"""How the report gets on: bars with the time left in a terminal, plain lines in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

LINE_EVERY_S = 15.0
"""How often a log hears of pieces."""


class Reporter(Protocol):
    """Who hears how the report gets on."""

    def say(self, line: str) -> None:
        """Hear something in words."""

    def working(self, kind: str, total: int, done: int) -> AbstractContextManager[Callable[[], None]]:
        """Hear that work of ``total`` pieces begins, ``done`` of them from before; call what it gives for each more."""


class Bars:
    """A progress bar for each kind of work."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def say(self, line: str) -> None:
        """Print it above the bars."""
        self._progress.console.print(line, markup=False, highlight=False)

    @contextmanager
    def working(self, kind: str, total: int, done: int) -> Iterator[Callable[[], None]]:
        """Show a bar."""
        task = self._progress.add_task(kind, total=total, completed=done)
        yield lambda: self._progress.advance(task)


class Lines:
    """A line when work begins, now and then, and when it is done."""

    def __init__(self, write: Callable[[str], None], now_s: Callable[[], float]) -> None:
        self._write = write
        self._now_s = now_s

    def say(self, line: str) -> None:
        """Write it."""
        self._write(line)

    @contextmanager
    def working(self, kind: str, total: int, done: int) -> Iterator[Callable[[], None]]:
        """Write how it gets on."""
        from_before = f", {done} of them from before" if done else ""
        self._write(f"{kind}: {total} pieces{from_before}")
        began_s = said_s = self._now_s()
        count = done

        def advanced() -> None:
            nonlocal count, said_s
            count += 1
            now_s = self._now_s()
            if now_s - said_s >= LINE_EVERY_S and count < total:
                said_s = now_s
                left_s = (now_s - began_s) / (count - done) * (total - count)
                self._write(f"{kind}: {count} of {total}, about {duration(left_s)} left")

        yield advanced
        if total > done:
            self._write(f"{kind}: done in {duration(self._now_s() - began_s)}")


def duration(seconds: float) -> str:
    """Return a length of time in words."""
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


@contextmanager
def shown() -> Iterator[Reporter]:
    """Show progress on stderr: bars in a terminal, else lines."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield Lines(lambda line: print(line, file=sys.stderr, flush=True), time.monotonic)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as progress:
        yield Bars(progress)
