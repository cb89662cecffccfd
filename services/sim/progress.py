"""How the run goes, on standard output: the lines that ``treenail up`` prints, for who watches the simulator's log.

The task says how it goes; the simulator only listens, because its log is the one that ``docker compose up sim`` shows.
"""

from __future__ import annotations

import time

from services.bus.service import Service
from services.rules.progress import LINE_EVERY_S, Progress
from services.wire.keys import EPISODE, HEARTBEAT, name_of
from services.wire.messages import Alive, EpisodeSummary, Experiment


def follow(service: Service, experiment: Experiment) -> None:
    """Print a line every few seconds, as long as the service works."""
    lines = Lines(f"cell {service.keys.cell}  " if service.options.fleet else "", experiment)
    service.subscribe(EPISODE, EpisodeSummary, lambda summary: lines.episode(summary, time.monotonic()), "task")
    service.subscribe(
        name_of(HEARTBEAT, service="task"), Alive, lambda alive: lines.heartbeat(alive, time.monotonic()), "task"
    )


class Lines:
    """What is printed when; times are those of a monotonic clock [s]."""

    def __init__(self, prefix: str, experiment: Experiment) -> None:
        self._prefix = prefix
        self._run = experiment.run
        self._progress = Progress(experiment.episodes, done=experiment.episodes_done)
        self._next = 0.0
        self._said = ""
        self._say(f"run {experiment.run}: {experiment.definition.name}, seed {experiment.seed}")
        self._say(self._progress.line())

    def episode(self, summary: EpisodeSummary, now: float) -> None:
        """Take a finished episode."""
        if summary.run != self._run:
            self._run, self._progress = summary.run, Progress(self._progress.episodes)
            self._say(f"run {summary.run}")
        self._progress.add(summary)
        if now >= self._next or self._progress.done >= self._progress.episodes:
            self._next = now + LINE_EVERY_S
            self._say(self._progress.line())

    def heartbeat(self, alive: Alive, now: float) -> None:
        """Take what the task says it is doing; one that works need not say so."""
        if alive.phase.startswith("waiting") and now >= self._next:
            self._next = now + LINE_EVERY_S
            self._say(f"episode {self._progress.done}/{self._progress.episodes}  {alive.phase}")
        elif alive.phase == "finished" and self._progress.done >= self._progress.episodes:
            self._say("finished; the cell stays up for queries, Ctrl-C stops it")

    def _say(self, text: str) -> None:
        if text != self._said:
            self._said = text
            print(f"{self._prefix}{text}", flush=True)
