"""``bench loop``: what being distributed costs. Per decision: physics, a bare Zenoh chain, and the real cell.

They are measured on the same decisions, one after the other in every round, because a busy machine changes; with
``--secure`` the real cell once more, with mutual TLS and access control.
"""

from __future__ import annotations

import queue
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from experiments.bench.bare_chain import BareChain, ChainTimes, bare_processes
from experiments.bench.pattern import Pattern, Timed, pattern, timed
from experiments.bench.values import Value, spread
from services.bus.access import GUEST
from services.bus.ports import free_port
from services.bus.service import Options
from services.bus.session import open_client
from services.cell.certificates import certify
from services.cell.client import Client
from services.cell.supervisor import Supervisor, last_line
from services.wire.definition_file import find, load, run_id
from services.wire.errors import CellError
from services.wire.keys import EPISODE
from services.wire.messages import EpisodeSummary

TARGET_RATIO = 2.0
"""At most this many bare chains may the distributed loop cost beside its physics."""
SECURED_RATIO = 1.2
"""At most this much may the cell cost with certificates, in terms of the cell without."""
EPISODE_WITHIN_S = 120.0
WORKERS = ("sim", "classifier", "agent")


class Case(NamedTuple):
    """What is run."""

    experiment: str
    overrides: tuple[str, ...]
    seed: int
    episodes: int
    """The first one is not counted: it holds start-up and first calls."""
    secure: bool = False
    """Whether the cell is measured with certificates as well."""


class Round(NamedTuple):
    """One measurement of everything."""

    in_process: Timed
    chain: ChainTimes
    distributed_s: float
    secured_s: float | None = None


def measure(case: Case, rounds: int) -> dict[str, Value]:
    """Measure so many rounds. Raises CellError when the cell does not do what the run in one process does."""
    definition = load(case.experiment, case.overrides)
    counted = case.episodes - 1
    plan = pattern(definition, case.seed, counted)
    found = []
    for number in range(rounds):
        in_process, chain = timed(definition, case.seed, counted), bare_chain(plan)
        # The two take turns at being first: a machine's speed changes with time.
        kinds = (False, True) if case.secure else (False,)
        cells = {secure: distributed(case, plan, secure=secure) for secure in kinds[:: -1 if number % 2 else 1]}
        found.append(Round(in_process, chain, cells[False], cells.get(True)))
    return report(case, plan, found)


def report(case: Case, plan: Pattern, rounds: Sequence[Round]) -> dict[str, Value]:
    """Return the figures of some rounds."""
    decisions, motions = plan.decisions, plan.motions

    def each(seconds: Sequence[float], count: int) -> dict[str, float]:
        return spread([1e6 * value / count for value in seconds])

    ratio = spread([(one.distributed_s - one.in_process.physics_s) / one.chain.total_s for one in rounds])
    figures: dict[str, Value] = {
        "experiment": case.experiment,
        "seed": case.seed,
        "rounds": len(rounds),
        "episodes": len(plan.summaries),
        "decisions": decisions,
        "motions": motions,
        "physics_us": each([one.in_process.physics_s for one in rounds], decisions),
        "in_process_us": each([one.in_process.total_s for one in rounds], decisions),
        "bare_chain_us": each([one.chain.total_s for one in rounds], decisions),
        "distributed_us": each([one.distributed_s for one in rounds], decisions),
        "bare_motion_us": each([one.chain.motions_s for one in rounds], motions),
        "bare_decision_us": each([one.chain.decisions_s for one in rounds], decisions),
        "in_process_decisions_per_s": spread([decisions / one.in_process.total_s for one in rounds]),
        "in_process_motions_per_s": spread([motions / one.in_process.total_s for one in rounds]),
        "distributed_decisions_per_s": spread([decisions / one.distributed_s for one in rounds]),
        "ratio": ratio,
        "target_ratio": TARGET_RATIO,
        "target_met": ratio["median"] <= TARGET_RATIO,
    }
    secured = [(one.secured_s, one.distributed_s) for one in rounds if one.secured_s is not None]
    if secured:
        cost = spread([with_s / without_s for with_s, without_s in secured])
        figures["secured_us"] = each([with_s for with_s, _ in secured], decisions)
        figures["secured_ratio"] = cost
        figures["secured_target_ratio"] = SECURED_RATIO
        figures["secured_target_met"] = cost["median"] <= SECURED_RATIO
    return figures


def bare_chain(plan: Pattern) -> ChainTimes:
    """Play the pattern through processes that do nothing, and a router as the cell has it."""
    with _cell() as (supervisor, endpoint, _), bare_processes(endpoint) as running:
        supervisor.start("router", "--listen", endpoint)
        session = open_client([endpoint])
        try:
            chain = BareChain(session)
            chain.wait(running)
            chain.play(plan.exchanges[: len(plan.exchanges) // 10])
            return chain.play(plan.exchanges)
        finally:
            session.close()  # type: ignore[no-untyped-call]


def distributed(case: Case, plan: Pattern, *, secure: bool = False) -> float:
    """Run a cell and return the time [s] from the end of its first episode to the end of its last.

    With ``secure``, it has certificates, made for it alone.
    """
    definition = load(case.experiment, case.overrides)
    with _cell(secure=secure) as (supervisor, endpoint, folder):
        cell = ("--cell", "bench", "--connect", endpoint)
        overrides = [word for item in case.overrides for word in ("--set", item)]
        length = ("--seed", str(case.seed), "--episodes", str(case.episodes))
        supervisor.start("router", "--listen", endpoint)
        us = None if supervisor.certs is None else supervisor.certs / GUEST
        with Client(Options("bench", (endpoint,), certs=us)) as client:
            arrived: queue.SimpleQueue[tuple[float, EpisodeSummary]] = queue.SimpleQueue()
            client.subscribe(EPISODE, EpisodeSummary, lambda summary: arrived.put((time.perf_counter(), summary)))
            supervisor.start("store", *cell, "--file", str(folder / "store.sqlite"))
            experiment = str(find(case.experiment).resolve())
            supervisor.start("task", *cell, "--experiment", experiment, *overrides, *length)
            for name in WORKERS:
                supervisor.start(name, *cell)
            ends = [_next(arrived, supervisor) for _ in range(case.episodes)]
    got = tuple(summary for _, summary in ends[1:])
    if got != plan.summaries:
        raise CellError(f"bench: expected the cell to repeat run {run_id(definition, case.seed)}, got another one")
    return ends[-1][0] - ends[0][0]


@contextmanager
def _cell(*, secure: bool = False) -> Iterator[tuple[Supervisor, str, Path]]:
    """A supervisor, a private endpoint and a folder; all that was started has ended afterwards."""
    with tempfile.TemporaryDirectory(prefix="treenail-bench-") as name:
        certs = Path(name) / "certs" if secure else None
        if certs is not None:
            certify(certs, [], days=1)
        supervisor = Supervisor(Path(name), lambda _: None, certs=certs)
        try:
            yield supervisor, f"{'tls' if secure else 'tcp'}/127.0.0.1:{free_port()}", Path(name)
        finally:
            supervisor.stop()


def _next(
    arrived: queue.SimpleQueue[tuple[float, EpisodeSummary]], supervisor: Supervisor
) -> tuple[float, EpisodeSummary]:
    """Wait for the next episode. Raises CellError when a process has ended, or nothing comes."""
    deadline = time.monotonic() + EPISODE_WITHIN_S
    while time.monotonic() < deadline:
        try:
            return arrived.get(timeout=0.5)
        except queue.Empty:
            running = supervisor.alive()
            for child in supervisor.children.values():
                if child.name not in running:
                    raise CellError(f"bench: expected {child.name} to run, it ended: {last_line(child.log)}") from None
    raise CellError(f"bench: expected an episode within {EPISODE_WITHIN_S:g} s, got none")
