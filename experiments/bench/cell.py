"""A cell to be measured: started as ``treenail up sim`` does, and nothing is started again, or it would be measured."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import NamedTuple

from experiments.bench.processes import mind
from services.cell.client import Client
from services.cell.local import LocalCell, temporary_cell
from services.cell.plan import Plan, make_plan
from services.wire.definition import Definition
from services.wire.definition_file import load
from services.wire.errors import CellError
from services.wire.keys import EPISODE, GUEST
from services.wire.messages import EpisodeSummary

CELL = "bench"
ENDLESS = 1_000_000
"""Episodes: more than there is time for, so that the run never ends before the time is over."""
EPISODE_WITHIN_S = 120.0
LOOK_EVERY_S = 0.02


class Subject(NamedTuple):
    """What is run."""

    experiment: str
    overrides: tuple[str, ...]
    seed: int

    @property
    def definition(self) -> Definition:
        """The definition, read. Raises DefinitionError."""
        return load(self.experiment, self.overrides)

    def plan(self, episodes: int = ENDLESS, *, together: bool = False) -> Plan:
        """Return the plan of a cell that runs it, ``together`` with most of its services in one process."""
        return make_plan(
            self.experiment,
            overrides=self.overrides,
            seed=self.seed,
            episodes=episodes,
            cell=CELL,
            fresh=True,
            together=together,
        )


class MeasuredCell:
    """A cell, a client of it, and what it has finished."""

    def __init__(self, cell: LocalCell, client: Client) -> None:
        """Begin to listen for finished episodes."""
        self.cell = cell
        self.client = client
        self.summaries: list[EpisodeSummary] = []
        self.decisions = 0
        """Of the finished episodes."""
        self.finished_s: list[float] = []
        """When each episode was heard of, as ``time.perf_counter``."""
        client.subscribe(EPISODE, EpisodeSummary, self._note)

    def mind(self) -> None:
        """Raise CellError when a process has ended."""
        mind(self.cell.supervisor)

    def wait(self, episodes: int = 1) -> None:
        """Wait until so many episodes are finished. Raises CellError when a process has ended, or nothing comes."""
        count, deadline = len(self.summaries), time.monotonic() + EPISODE_WITHIN_S
        while len(self.summaries) < episodes:
            self.mind()
            if len(self.summaries) > count:
                count, deadline = len(self.summaries), time.monotonic() + EPISODE_WITHIN_S
            if time.monotonic() > deadline:
                raise CellError(f"bench: expected an episode within {EPISODE_WITHIN_S:g} s, got none")
            time.sleep(LOOK_EVERY_S)

    def _note(self, summary: EpisodeSummary) -> None:
        self.finished_s.append(time.perf_counter())
        self.decisions += summary.decisions
        self.summaries.append(summary)


@contextmanager
def measured_cell(
    plan: Plan,
    *,
    secure: bool = False,
    options: Mapping[str, Sequence[str]] | None = None,
    ahead: AbstractContextManager[object] | None = None,
) -> Iterator[MeasuredCell]:
    """A planned cell at work, in a folder of its own; all that was started has ended afterwards.

    ``options`` are more options by service; the router is started within ``ahead``.
    """
    with temporary_cell(plan, secure=secure, options=options) as cell:
        with ahead or nullcontext():
            cell.start("router")
        with cell.client(GUEST) as client:
            measured = MeasuredCell(cell, client)
            cell.start(*(name for name in cell.services if name != "router"))
            yield measured


def moments(seconds: float, every_s: float) -> Iterator[float]:
    """Yield the time [s] since the beginning, at even distances, until ``seconds`` are over."""
    due = start = time.monotonic()
    while due <= start + seconds:
        time.sleep(max(0.0, due - time.monotonic()))
        yield time.monotonic() - start
        due += every_s
