"""How a run is going: one line for a log, or a live panel for a terminal."""

from __future__ import annotations

import time
from collections.abc import Sequence

from rich.console import Console
from rich.live import Live
from rich.table import Table

from services.rules.progress import LINE_EVERY_S, Progress


class Reporter:
    """Shows progress: live in a terminal, as plain lines elsewhere."""

    def __init__(self, progress: Progress, title: str, viewer: str) -> None:
        self.console = Console()
        self._progress = progress
        self._title = title
        self._viewer = viewer
        self._live = Live(console=self.console, auto_refresh=False) if self.console.is_terminal else None
        self._next = 0.0
        self._shown = -1

    def __enter__(self) -> Reporter:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def say(self, text: str) -> None:
        """Print a line beside the progress."""
        if self._live is not None:
            self._live.console.print(text, highlight=False)
        else:
            print(text, flush=True)

    def show(self, alive: Sequence[str], phase: str, *, now: bool = False) -> None:
        """Show where the run stands, at most every second or two unless ``now``."""
        if self._live is not None:
            self._live.update(self._panel(alive, phase), refresh=True)
            return
        moment = time.monotonic()
        if not now and moment < self._next:
            return
        if self._progress.done != self._shown:
            print(self._progress.line(), flush=True)
        elif phase.startswith(("waiting", "stopped")):
            print(f"episode {self._progress.done}/{self._progress.episodes}  {phase}", flush=True)
        else:
            return
        self._shown = self._progress.done
        self._next = moment + LINE_EVERY_S

    def _panel(self, alive: Sequence[str], phase: str) -> Table:
        panel = Table(title=self._title, show_header=False, min_width=60)
        panel.add_column(style="cyan", no_wrap=True)
        panel.add_column()
        for label, value in self._progress.fields().items():
            panel.add_row(label, value)
        panel.add_row("processes", " ".join(alive))
        panel.add_row("phase", phase)
        if self._viewer:
            panel.add_row("viewer", self._viewer)
        return panel
