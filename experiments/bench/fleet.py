"""``bench fleet``: several cells round one router and one store: do they disturb each other, and what does each cost?

Every cell has its own sim, task, classifier and agent, and ends in the bytes of a run in one process with its seed.
Workers come first and tasks last, so that all cells are at work at the same time.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from experiments.bench.cell import MeasuredCell, Subject
from experiments.bench.processes import MB, Usage, mind, total, usages
from experiments.bench.values import Value, spread
from experiments.lab.run import run_seed
from services.cell.ended import EndedRun, result_of
from services.cell.local import LocalCell
from services.cell.plan import Plan
from services.cell.watch import Watch
from services.rules.results import RunResult
from services.wire.errors import CellError
from services.wire.keys import CLAIM, ROOT, wild
from services.wire.randomness import MAX_SEED

READY_WITHIN_S = 120.0
POLL_S = 0.02
BESIDE_TASK = ("sim", "classifier", "agent")
SHARED = ("router", "store")


class Moment(NamedTuple):
    """A fleet at one moment."""

    time_s: float
    decisions: int
    episodes: int
    cells: tuple[Usage, ...]
    """Of each cell's four processes together."""
    shared: Mapping[str, Usage]
    """Router and store."""


class Fleet(NamedTuple):
    """One measurement."""

    first: Moment
    """When every cell has finished its first episode."""
    last: Moment
    """When every cell has finished its last one."""
    equal: tuple[bool, ...]
    """Which cells ended in the bytes of a run in one process."""


def measure(subject: Subject, cells: Sequence[int], episodes: int) -> dict[str, Value]:
    """Measure fleets of so many cells, each with ``episodes`` (2 or more) and a seed of its own.

    Time is taken from when all cells have finished their first episode. Raises TreenailError when one cannot be run.
    """
    definition, most = subject.definition, max(cells)
    if subject.seed + most - 1 > MAX_SEED:
        raise CellError(f"--seed: expected at most {MAX_SEED - most + 1} with {most} cells, got {subject.seed}")
    expected = [run_seed(definition, subject.seed + n, episodes, lambda _: None).result for n in range(most)]
    plan = subject.plan(episodes)
    messages = _messages(plan)
    return report(subject, episodes, messages, [(count, _run(plan, expected[:count])) for count in cells])


def report(
    subject: Subject, episodes: int, messages: dict[str, Value], fleets: Sequence[tuple[int, Fleet]]
) -> dict[str, Value]:
    """Return the figures of some fleets, given by their number of cells."""
    return {
        "experiment": subject.experiment,
        "seed": subject.seed,
        "episodes": episodes,
        "equal": all(all(fleet.equal) for _, fleet in fleets),
        "messages_per_decision": messages,
        "fleets": [_figures(count, fleet) for count, fleet in fleets],
    }


def _figures(count: int, fleet: Fleet) -> dict[str, Value]:
    first, last = fleet.first, fleet.last
    seconds = last.time_s - first.time_s
    decisions, episodes = last.decisions - first.decisions, last.episodes - first.episodes
    spent = [after.cpu_s - before.cpu_s for before, after in zip(first.cells, last.cells, strict=True)]
    shared = {name: last.shared[name].cpu_s - first.shared[name].cpu_s for name in SHARED}
    return {
        "cells": count,
        "equal": f"{sum(fleet.equal)} of {count}",
        "seconds": seconds,
        "ms_per_episode_and_cell": 1000 * seconds * count / episodes,
        "decisions_per_s": decisions / seconds,
        "decisions_per_s_and_cell": decisions / seconds / count,
        "cell_cpu_ms_per_decision": 1000 * sum(spent) / decisions,
        "router_cpu_us_per_decision": 1e6 * shared["router"] / decisions,
        "store_cpu_us_per_decision": 1e6 * shared["store"] / decisions,
        "cpu_cores_used": (sum(spent) + sum(shared.values())) / seconds,
        "cell_rss_mb": spread([usage.rss_bytes / MB for usage in last.cells]),
        "router_rss_mb": last.shared["router"].rss_bytes / MB,
        "store_rss_mb": last.shared["store"].rss_bytes / MB,
    }


class _Running:
    """A fleet's processes, with the tasks not yet started."""

    def __init__(self, shared: LocalCell, cells: Sequence[MeasuredCell]) -> None:
        self._shared = shared
        self.cells = cells

    def start(self) -> None:
        """Start the tasks, all at once."""
        for measured in self.cells:
            measured.cell.start("task")

    def mind(self) -> None:
        """Raise CellError when a process has ended."""
        mind(self._shared.supervisor, *(measured.cell.supervisor for measured in self.cells))

    def wait(self, episodes: int) -> Moment:
        """Return what there is when every cell has finished so many episodes."""
        for measured in self.cells:
            measured.wait(episodes)
        self.mind()
        return Moment(
            time.monotonic(),
            sum(measured.decisions for measured in self.cells),
            sum(len(measured.summaries) for measured in self.cells),
            tuple(total(usages(measured.cell.supervisor).values()) for measured in self.cells),
            usages(self._shared.supervisor),
        )


def _run(plan: Plan, expected: Sequence[RunResult]) -> Fleet:
    """Run a fleet of as many cells as there are results to expect."""
    with _fleet(plan, len(expected)) as running:
        running.start()
        first, last = running.wait(1), running.wait(plan.episodes)
        equal = []
        for measured, single in zip(running.cells, expected, strict=True):
            mine = measured.cell.plan
            ended = EndedRun(mine.run, mine.definition, mine.seed, mine.episodes, 0)
            equal.append(result_of(measured.client, ended, running.mind) == single)
    return Fleet(first, last, tuple(equal))


def _messages(plan: Plan) -> dict[str, Value]:
    """Return messages and bytes per decision by key, as somebody who listens to a whole cell counts them.

    ``home`` and ``move`` are queries, which nobody can listen to: their number is that of the motions.
    """
    with _fleet(plan, 1) as running:
        (cell,) = running.cells
        watch = Watch(cell.client, 1)
        running.start()
        while len(cell.summaries) < plan.episodes:
            running.mind()
            watch.read_for(POLL_S)
        watch.read_for(1.0)  # the last episode's checkpoint and journal come after its summary
    if not watch.traffic.complete:
        raise CellError("bench: expected to hear all that a cell publishes, it was too much")
    rates: dict[str, Value] = {
        name: {"messages": count.messages / cell.decisions, "bytes": count.payload_bytes / cell.decisions}
        for name, count in sorted(watch.traffic.counts.items())
        if name != "heartbeat"  # once a second whatever is decided
    }
    motions = sum(summary.moves + 1 for summary in cell.summaries)
    return {**rates, "home and move": {"questions": motions / cell.decisions}}


@contextmanager
def _fleet(plan: Plan, count: int) -> Iterator[_Running]:
    """A fleet that is ready for its tasks; all that was started has ended afterwards."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="treenail-bench-")))
        shared = stack.enter_context(
            LocalCell(replace(plan, out=folder / "shared"), options={"store": ("--fleet", str(count))})
        )
        shared.start(*SHARED)
        cells = []
        for number in range(1, count + 1):
            mine = replace(plan, cell=str(number), seed=plan.seed + number - 1, out=folder / str(number))
            cell = stack.enter_context(LocalCell(mine))
            cells.append(MeasuredCell(cell, stack.enter_context(cell.client())))
            cell.start(*BESIDE_TASK)
        running = _Running(shared, cells)
        _wait_for_claims(running, count * (len(BESIDE_TASK) + 1))
        yield running


def _wait_for_claims(running: _Running, count: int) -> None:
    """Return when so many processes have their roles. Raises CellError when they do not come to that."""
    session, deadline = running.cells[0].client.session, time.monotonic() + READY_WITHIN_S
    while (claims := len(list(session.liveliness().get(f"{ROOT}/*/{wild(CLAIM)}", timeout=2.0)))) < count:
        running.mind()
        if time.monotonic() > deadline:
            raise CellError(f"bench: expected {count} processes within {READY_WITHIN_S:g} s, got {claims}")
        time.sleep(0.1)
