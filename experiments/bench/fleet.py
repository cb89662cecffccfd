"""``bench fleet``: several cells round one router and one store: do they disturb each other, and what does each cost?

Every cell has its own sim, task, classifier and agent, and ends in the bytes of a run in one process with its seed.
Workers come first and tasks last, so that all cells are at work at the same time.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from experiments.bench.loop import WORKERS
from experiments.bench.processes import MB, Usage, mind, total, usages
from experiments.bench.values import Value, spread
from experiments.lab.run import run_seed
from services.bus.ports import free_port
from services.bus.service import Options
from services.cell.client import Client
from services.cell.ended import EndedRun, result_of
from services.cell.supervisor import Supervisor
from services.cell.watch import Watch
from services.rules.results import RunResult
from services.wire.definition import Definition
from services.wire.definition_file import find, load, run_id
from services.wire.errors import CellError
from services.wire.keys import EPISODE
from services.wire.messages import EpisodeSummary
from services.wire.randomness import MAX_SEED

READY_WITHIN_S = 120.0
EPISODE_WITHIN_S = 120.0
POLL_S = 0.02
LOOP = (*WORKERS, "task")
SHARED = ("router", "store")


class Case(NamedTuple):
    """What is run."""

    experiment: str
    overrides: tuple[str, ...]
    seed: int
    """Of the first cell; seeds count up from it."""
    cells: tuple[int, ...]
    """Numbers of cells to measure, one after the other."""
    episodes: int
    """Of each cell, at least 2: time is taken from when all cells have finished their first one."""


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


def measure(case: Case) -> dict[str, Value]:
    """Measure fleets of all the sizes. Raises TreenailError when one cannot be run."""
    definition = load(case.experiment, case.overrides)
    most = max(case.cells)
    if case.seed + most - 1 > MAX_SEED:
        raise CellError(f"--seed: expected at most {MAX_SEED - most + 1} with {most} cells, got {case.seed}")
    expected = [run_seed(definition, case.seed + place, case.episodes, _nothing).result for place in range(most)]
    messages = _messages(case, definition)
    return report(case, messages, [(count, _run(case, definition, expected[:count])) for count in case.cells])


def report(case: Case, messages: dict[str, Value], found: Sequence[tuple[int, Fleet]]) -> dict[str, Value]:
    """Return the figures of some fleets, given by their number of cells."""
    return {
        "experiment": case.experiment,
        "seed": case.seed,
        "episodes": case.episodes,
        "equal": all(all(fleet.equal) for _, fleet in found),
        "messages_per_decision": messages,
        "fleets": [_figures(count, fleet) for count, fleet in found],
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
        "cell_rss_mb": spread([one.rss_bytes / MB for one in last.cells]),
        "router_rss_mb": last.shared["router"].rss_bytes / MB,
        "store_rss_mb": last.shared["store"].rss_bytes / MB,
    }


def _nothing(_: int) -> None:
    """Hear nothing of how far a run is."""


class _Cell:
    """One cell of a fleet, its processes and what has come of it."""

    def __init__(self, name: str, seed: int, supervisor: Supervisor, client: Client) -> None:
        self.name = name
        self.seed = seed
        self.supervisor = supervisor
        self.client = client
        self.summaries: list[EpisodeSummary] = []
        client.subscribe(EPISODE, EpisodeSummary, self.summaries.append)


class _Running:
    """A fleet's processes, with the tasks not yet started."""

    def __init__(self, case: Case, shared: Supervisor, cells: Sequence[_Cell], endpoint: str) -> None:
        self._case, self._shared, self._endpoint = case, shared, endpoint
        self.cells = cells

    def start(self) -> None:
        """Start the tasks, all at once."""
        case = self._case
        overrides = [word for item in case.overrides for word in ("--set", item)]
        experiment = ("--experiment", str(find(case.experiment).resolve()), *overrides)
        for cell in self.cells:
            where = ("--cell", cell.name, "--connect", self._endpoint)
            length = ("--seed", str(cell.seed), "--episodes", str(case.episodes))
            cell.supervisor.start("task", *where, *experiment, *length)

    def mind(self) -> None:
        """Raise CellError when a process has ended."""
        mind(self._shared, *(cell.supervisor for cell in self.cells))

    def wait(self, episodes: int) -> Moment:
        """Return what there is when every cell has finished so many episodes."""
        known, deadline = 0, time.monotonic() + EPISODE_WITHIN_S
        while min(len(cell.summaries) for cell in self.cells) < episodes:
            self.mind()
            if (now := sum(len(cell.summaries) for cell in self.cells)) > known:
                known, deadline = now, time.monotonic() + EPISODE_WITHIN_S
            if time.monotonic() > deadline:
                raise CellError(f"bench: expected an episode within {EPISODE_WITHIN_S:g} s, got none")
            time.sleep(POLL_S)
        return self._moment()

    def _moment(self) -> Moment:
        summaries = [summary for cell in self.cells for summary in tuple(cell.summaries)]
        return Moment(
            time.monotonic(),
            sum(summary.decisions for summary in summaries),
            len(summaries),
            tuple(total(usages(cell.supervisor).values()) for cell in self.cells),
            usages(self._shared),
        )


def _run(case: Case, definition: Definition, expected: Sequence[RunResult]) -> Fleet:
    """Run a fleet of as many cells as there are results to expect."""
    with _fleet(case, len(expected)) as running:
        running.start()
        first, last = running.wait(1), running.wait(case.episodes)
        equal = []
        for cell, single in zip(running.cells, expected, strict=True):
            ended = EndedRun(run_id(definition, cell.seed), definition, cell.seed, case.episodes, 0)
            equal.append(result_of(cell.client, ended, running.mind) == single)
    return Fleet(first, last, tuple(equal))


def _messages(case: Case, definition: Definition) -> dict[str, Value]:
    """Return messages and bytes per decision by key, as somebody who listens to a whole cell counts them.

    ``home`` and ``move`` are queries, which nobody can listen to: their number is that of the motions.
    """
    with _fleet(case, 1) as running:
        (cell,) = running.cells
        watch = Watch(cell.client, 1)
        running.start()
        while len(cell.summaries) < case.episodes:
            running.mind()
            watch.read_for(POLL_S)
        watch.read_for(1.0)  # the last episode's checkpoint and journal come after its summary
    if not watch.traffic.complete:
        raise CellError("bench: expected to hear all that a cell publishes, it was too much")
    decisions = sum(summary.decisions for summary in cell.summaries)
    found: dict[str, Value] = {
        name: {"messages": one.messages / decisions, "bytes": one.payload_bytes / decisions}
        for name, one in sorted(watch.traffic.counts.items())
        if name != "heartbeat"  # once a second whatever is decided
    }
    motions = sum(summary.moves + 1 for summary in cell.summaries)
    return {**found, "home and move": {"questions": motions / decisions}}


@contextmanager
def _fleet(case: Case, count: int) -> Iterator[_Running]:
    """A fleet that is ready for its tasks; all that was started has ended afterwards."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with tempfile.TemporaryDirectory(prefix="treenail-bench-") as name, ExitStack() as stack:
        shared = _supervisor(Path(name), "shared", stack)
        shared.start("router", "--listen", endpoint)
        store = ("--fleet", str(count), "--file", str(Path(name) / "store.sqlite"))
        shared.start("store", *store, "--connect", endpoint)
        cells = []
        for place in range(count):
            cell = str(place + 1)
            client = stack.enter_context(Client(Options(cell, (endpoint,))))
            cells.append(_Cell(cell, case.seed + place, _supervisor(Path(name), cell, stack), client))
            for service in WORKERS:
                cells[-1].supervisor.start(service, "--cell", cell, "--connect", endpoint)
        running = _Running(case, shared, cells, endpoint)
        _wait_for_claims(running, count * (len(WORKERS) + 1))
        yield running


def _supervisor(folder: Path, name: str, stack: ExitStack) -> Supervisor:
    (folder / name).mkdir()
    supervisor = Supervisor(folder / name, lambda _: None)
    stack.callback(supervisor.stop)
    return supervisor


def _wait_for_claims(running: _Running, count: int) -> None:
    """Return when so many processes have their roles. Raises CellError when they do not come to that."""
    session, deadline = running.cells[0].client.session, time.monotonic() + READY_WITHIN_S
    while (found := len(list(session.liveliness().get("treenail/*/claim/*/*", timeout=2.0)))) < count:
        running.mind()
        if time.monotonic() > deadline:
            raise CellError(f"bench: expected {count} processes within {READY_WITHIN_S:g} s, got {found}")
        time.sleep(0.1)
