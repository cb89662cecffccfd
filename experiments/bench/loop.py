"""``bench loop``: what being distributed costs. Per decision: physics, a bare Zenoh chain, and the real cell.

They are measured on the same decisions, one after the other in every round, because a busy machine changes; with
``--secure`` the real cell once more, with mutual TLS and access control, and with ``--together`` with task, classifier,
agent and simulator in one process.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from experiments.bench.bare_chain import BareChain, ChainTimes, bare_processes
from experiments.bench.cell import Subject, measured_cell
from experiments.bench.pattern import Pattern, Timed, pattern, timed
from experiments.bench.values import Value, spread
from services.bus.session import open_client
from services.cell.local import temporary_cell
from services.wire.errors import CellError

TARGET_RATIO = 2.0
"""At most this many bare chains may the distributed loop cost beside its physics."""
SECURED_RATIO = 1.2
"""At most this much may the cell cost with certificates, in terms of the cell without."""


class Kind(NamedTuple):
    """How a cell is measured."""

    secure: bool = False
    """With certificates, made for it alone."""
    together: bool = False
    """With task, classifier, agent and simulator in one process."""


_AS_IT_IS, _SECURED, _TOGETHER = Kind(), Kind(secure=True), Kind(together=True)


class Round(NamedTuple):
    """One measurement of everything."""

    in_process: Timed
    chain: ChainTimes
    distributed_s: float
    secured_s: float | None = None
    together_s: float | None = None


def measure(
    subject: Subject, episodes: int, rounds: int, *, secure: bool = False, together: bool = False
) -> dict[str, Value]:
    """Measure so many rounds. Raises CellError when the cell does not do what the run in one process does.

    The first of the episodes is not counted: it holds start-up and first calls. With ``secure`` the cell is measured
    with certificates as well, with ``together`` as well with four services in one process.
    """
    definition, counted = subject.definition, episodes - 1
    noted = pattern(definition, subject.seed, counted)
    measured = []
    for number in range(rounds):
        in_process, chain = timed(definition, subject.seed, counted), bare_chain(subject, noted)
        kinds = [_AS_IT_IS, *([_SECURED] if secure else []), *([_TOGETHER] if together else [])]
        if number % 2:  # they take turns at being first: a machine's speed changes with time
            kinds.reverse()
        cells = {kind: distributed(subject, noted, kind) for kind in kinds}
        measured.append(Round(in_process, chain, cells[_AS_IT_IS], cells.get(_SECURED), cells.get(_TOGETHER)))
    return report(subject, noted, measured)


def report(subject: Subject, plan: Pattern, rounds: Sequence[Round]) -> dict[str, Value]:
    """Return the figures of some rounds."""
    decisions, motions = plan.decisions, plan.motions

    def each(seconds: Sequence[float], count: int) -> dict[str, float]:
        return spread([1e6 * value / count for value in seconds])

    ratio = spread([(trial.distributed_s - trial.in_process.physics_s) / trial.chain.total_s for trial in rounds])
    figures: dict[str, Value] = {
        "experiment": subject.experiment,
        "seed": subject.seed,
        "rounds": len(rounds),
        "episodes": len(plan.summaries),
        "decisions": decisions,
        "motions": motions,
        "physics_us": each([trial.in_process.physics_s for trial in rounds], decisions),
        "in_process_us": each([trial.in_process.total_s for trial in rounds], decisions),
        "bare_chain_us": each([trial.chain.total_s for trial in rounds], decisions),
        "distributed_us": each([trial.distributed_s for trial in rounds], decisions),
        "bare_motion_us": each([trial.chain.motions_s for trial in rounds], motions),
        "bare_decision_us": each([trial.chain.decisions_s for trial in rounds], decisions),
        "in_process_decisions_per_s": spread([decisions / trial.in_process.total_s for trial in rounds]),
        "in_process_motions_per_s": spread([motions / trial.in_process.total_s for trial in rounds]),
        "distributed_decisions_per_s": spread([decisions / trial.distributed_s for trial in rounds]),
        "ratio": ratio,
        "target_ratio": TARGET_RATIO,
        "target_met": ratio["median"] <= TARGET_RATIO,
    }
    secured = [(trial.secured_s, trial.distributed_s) for trial in rounds if trial.secured_s is not None]
    if secured:
        cost = spread([with_s / without_s for with_s, without_s in secured])
        figures["secured_us"] = each([with_s for with_s, _ in secured], decisions)
        figures["secured_ratio"] = cost
        figures["secured_target_ratio"] = SECURED_RATIO
        figures["secured_target_met"] = cost["median"] <= SECURED_RATIO
    together = [trial.together_s for trial in rounds if trial.together_s is not None]
    if together:
        figures["together_us"] = each(together, decisions)
        figures["together_decisions_per_s"] = spread([decisions / seconds for seconds in together])
    return figures


def bare_chain(subject: Subject, plan: Pattern) -> ChainTimes:
    """Play the pattern through processes that do nothing, and a router as the cell has it."""
    with temporary_cell(subject.plan()) as cell, bare_processes(cell.plan.endpoint) as running:
        cell.start("router")
        session = open_client([cell.plan.endpoint])
        try:
            chain = BareChain(session)
            chain.wait(running)
            chain.play(plan.exchanges[: len(plan.exchanges) // 10])
            return chain.play(plan.exchanges)
        finally:
            session.close()  # type: ignore[no-untyped-call]


def distributed(subject: Subject, plan: Pattern, kind: Kind) -> float:
    """Run a cell and return the time [s] from the end of its first episode to the end of its last."""
    episodes = len(plan.summaries) + 1
    with measured_cell(subject.plan(episodes, together=kind.together), secure=kind.secure) as measured:
        measured.wait(episodes)
        ran = measured.cell.plan.run
    if tuple(measured.summaries[1:]) != plan.summaries:
        raise CellError(f"bench: expected the cell to repeat run {ran}, got another one")
    return measured.finished_s[-1] - measured.finished_s[0]
