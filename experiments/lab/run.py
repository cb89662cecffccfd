"""Many runs at once, over the machine's cores. A seed that fails ends all of them, and so does Ctrl-C."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from experiments.lab.pool import Tell, spread
from services.rules.results import Digests, RunResult, episodes_digest
from services.rules.skill import NamedSkill
from services.wire.definition import Definition
from services.wire.messages import Swap


class Listener(Protocol):
    """Who hears how the runs get on. Called in the parent process, from one thread."""

    def started(self, seed: int) -> None:
        """Hear that a run begins."""

    def advanced(self, seed: int, episodes: int) -> None:
        """Hear, now and then, how many of its episodes a run has finished."""

    def finished(self, seed: int) -> None:
        """Hear that a run is over and its result is there."""


@dataclass(frozen=True)
class TimedRun:
    """A result, what was learnt, and how long the episodes took [s]; the time is no part of the result."""

    result: RunResult
    skill: NamedSkill
    seconds: float

    @property
    def moves_per_s(self) -> float:
        """Motions made per second of wall-clock time."""
        return sum(summary.moves for summary in self.result.episodes) / self.seconds


def run_seed(
    definition: Definition,
    seed: int,
    episodes: int,
    advanced: Callable[[int], bool | None],
    skill: NamedSkill | None = None,
    swaps: Sequence[Swap] = (),
) -> TimedRun:
    """Run one seed in this process; ``advanced`` hears the number of episodes finished after each, False ends it.

    ``skill`` is what the run begins with; it has to fit the definition. ``swaps`` are made in the course of it.
    """
    # Physics and compiled kernels are loaded where they are used: the parent would only start more slowly.
    from experiments.lab.in_process import InProcessRun

    run = InProcessRun(definition, seed, remember=True, skill=skill, swaps=swaps)
    began = time.perf_counter()
    summaries = []
    for summary in run.episodes(episodes):
        summaries.append(summary)
        if advanced(len(summaries)) is False:
            break
    seconds = time.perf_counter() - began
    digests: Digests = {
        "q_table": run.agent.learner.digest(),
        "art2": run.classifier.network.digest(),
        "episodes": episodes_digest(summaries),
    }
    return TimedRun(RunResult(seed, tuple(summaries), digests), run.learnt(), seconds)


def run_seeds(
    definition: Definition,
    seeds: Sequence[int],
    episodes: int,
    jobs: int,
    listener: Listener,
    skill: NamedSkill | None = None,
    swaps: Sequence[Swap] = (),
) -> tuple[TimedRun, ...]:
    """Run every seed for so many episodes, at most ``jobs`` at a time; results in ascending order of seeds.

    ``skill`` is what each of them begins with; it has to fit the definition. ``swaps`` are made in each of them.

    Raises PieceError, with its seed, when a run fails and Interrupted, with what
    has been run, upon Ctrl-C or SIGTERM; all processes have ended by then.
    """
    orders = [_Order(definition, seed, episodes, skill, tuple(swaps)) for seed in sorted(seeds)]

    def advanced(index: int, count: int) -> None:
        if count:
            listener.advanced(orders[index].seed, count)
        else:
            listener.started(orders[index].seed)

    done: dict[int, TimedRun] = {}
    try:
        for index, timed in spread(_run, orders, jobs, lambda order: f"seed {order.seed}", advanced, partly=True):
            done[orders[index].seed] = timed
            listener.finished(orders[index].seed)
    except KeyboardInterrupt:
        raise Interrupted(tuple(done[seed] for seed in sorted(done))) from None
    return tuple(done[order.seed] for order in orders)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C while runs were under way; ``runs`` are those with episodes, whole or in part, by seed."""

    def __init__(self, runs: tuple[TimedRun, ...]) -> None:
        super().__init__()
        self.runs = runs


class _Order(NamedTuple):
    """What a process is to run."""

    definition: Definition
    seed: int
    episodes: int
    skill: NamedSkill | None
    swaps: tuple[Swap, ...]


def _run(order: _Order, tell: Tell) -> TimedRun:
    return run_seed(order.definition, order.seed, order.episodes, tell, order.skill, order.swaps)
