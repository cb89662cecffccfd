"""How a run is going: one line for a log, or a live panel for a terminal."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence

from rich.console import RenderableType
from rich.live import Live
from rich.table import Table

from services.cell.terminal import Unread, console
from services.rules.progress import LINE_EVERY_S, Progress
from services.wire.messages import Alive

STARTING, WAITING = "starting", "waiting"


def because(phase: str, services: Iterable[Alive]) -> str:
    """Return what the task does and, while it waits, what the others say that holds them up.

    A robot that has not found its own other side yet cannot answer; only it knows why.
    """
    if not phase.startswith(WAITING):
        return phase
    usual = ("running", "making ", f"{WAITING} for task")
    held = [one for one in services if one.service != "task" and not one.phase.startswith(usual)]
    return "; ".join((phase, *(f"{one.service}: {one.phase}" for one in sorted(held, key=lambda one: one.service))))


class Reporter:
    """Shows progress: live in a terminal, as plain lines elsewhere. Nobody has to read it: the run goes on."""

    def __init__(self, progress: Progress, title: str, viewer: str) -> None:
        self._console = console()
        self._unread = Unread("treenail up")
        self._progress = progress
        self._title = title
        self._viewer = viewer
        self._live = Live(console=self._console, auto_refresh=False) if self._console.is_terminal else None
        self._next = 0.0
        self._shown = -1

    def __enter__(self) -> Reporter:
        if self._live is not None:
            self._unread.attempt(self._live.start)
        return self

    def __exit__(self, *_: object) -> None:
        self.end_live()

    def end_live(self) -> None:
        """Leave the panel as it stands: what is printed from now on comes below it, and stays."""
        live, self._live = self._live, None
        if live is not None:
            self._unread.attempt(live.stop)

    def say(self, text: str) -> None:
        """Print a line beside the progress."""
        self._unread.attempt(lambda: self._console.print(text, soft_wrap=True))

    def print(self, table: RenderableType) -> None:
        """Print something else than a line; only after ``end_live``."""
        self._unread.attempt(lambda: self._console.print(table))

    def show(self, alive: Sequence[str], phase: str, *, now: bool = False) -> None:
        """Show where the run stands, at most every second or two unless ``now``."""
        live = self._live
        if live is not None:
            self._unread.attempt(lambda: live.update(self._panel(alive, phase), refresh=True))
            return
        moment = time.monotonic()
        if phase == STARTING or (not now and moment < self._next):
            return
        if self._progress.done != self._shown:
            self.say(self._progress.line())
        elif phase.startswith((WAITING, "stopped")):
            self.say(f"episode {self._progress.done}/{self._progress.episodes}  {phase}")
        else:
            return
        self._shown = self._progress.done
        self._next = moment + LINE_EVERY_S

    def _panel(self, alive: Sequence[str], phase: str) -> Table:
        panel = Table(title=self._title, show_header=False, min_width=60)
        panel.add_column(style="cyan", no_wrap=True)
        panel.add_column()
        # How far an earlier start of the run came is known as soon as the task says so.
        fields = {"episode": f"?/{self._progress.episodes}"} if phase == STARTING else self._progress.fields()
        for label, value in fields.items():
            panel.add_row(label, value)
        panel.add_row("processes", " ".join(alive))
        panel.add_row("phase", phase)
        if self._viewer:
            panel.add_row("viewer", self._viewer)
        return panel
