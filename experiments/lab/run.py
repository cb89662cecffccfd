"""Many runs at once: every seed in a process of its own, started afresh, so that nothing leaks from one to another.

A seed that fails ends all of them, and so does Ctrl-C; either way no child is left behind.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import connection
from multiprocessing.context import SpawnProcess
from typing import Protocol

from experiments.lab.children import GRACE_S, POLL_S, how_it_ended, interrupt_noted, start
from services.rules.results import Digests, RunResult, episodes_digest
from services.rules.skill import NamedSkill
from services.wire.definition import Definition
from services.wire.errors import TreenailError
from services.wire.messages import Swap


class SeedError(TreenailError):
    """One of the runs failed; the message names its seed."""


class Listener(Protocol):
    """Who hears how the runs get on. Called in the parent process, from one thread."""

    def started(self, seed: int) -> None:
        """Hear that a run begins."""

    def advanced(self, seed: int, episodes: int) -> None:
        """Hear that a run has finished so many of its episodes."""

    def finished(self, seed: int) -> None:
        """Hear that a run is over and its result is there."""


@dataclass(frozen=True)
class TimedRun:
    """A result, and how long its episodes took [s]; the time is no part of the result."""

    result: RunResult
    seconds: float

    @property
    def moves_per_s(self) -> float:
        """Motions made per second of wall-clock time."""
        return sum(summary.moves for summary in self.result.episodes) / self.seconds


@dataclass(frozen=True)
class _Failure:
    """What a child sends instead of its result."""

    message: str


@dataclass(frozen=True)
class _Child:
    seed: int
    process: SpawnProcess


def usable_cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))


def run_seed(
    definition: Definition,
    seed: int,
    episodes: int,
    advanced: Callable[[int], None],
    skill: NamedSkill | None = None,
    swaps: Sequence[Swap] = (),
) -> TimedRun:
    """Run one seed in this process; ``advanced`` hears the number of episodes finished after each.

    ``skill`` is what the run begins with; it has to fit the definition. ``swaps`` are made in the course of it.
    """
    # Physics and compiled kernels are loaded where they are used: the parent would only start more slowly.
    from experiments.lab.in_process import InProcessRun

    run = InProcessRun(definition, seed, remember=True, skill=skill, swaps=swaps)
    began = time.perf_counter()
    summaries = []
    for summary in run.episodes(episodes):
        summaries.append(summary)
        advanced(len(summaries))
    seconds = time.perf_counter() - began
    digests: Digests = {
        "q_table": run.agent.learner.digest(),
        "art2": run.classifier.network.digest(),
        "episodes": episodes_digest(summaries),
    }
    return TimedRun(RunResult(seed, tuple(summaries), digests), seconds)


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

    To be called from the main thread. Raises SeedError when a run fails and KeyboardInterrupt upon Ctrl-C or SIGTERM;
    all children have ended by then. Of a parent that is killed outright, each child ends with its current episode.
    """
    waiting, children, done = deque(sorted(seeds)), dict[connection.Connection, _Child](), dict[int, TimedRun]()
    with interrupt_noted() as interrupted:
        try:
            while waiting or children:
                while waiting and len(children) < jobs:
                    seed = waiting.popleft()
                    new, child = _start(definition, seed, episodes, skill, swaps)
                    children[new] = child
                    listener.started(seed)
                heard = connection.wait(list(children), timeout=POLL_S)
                if interrupted.is_set():
                    raise KeyboardInterrupt
                for receiver in [known for known in children if known in heard]:
                    _hear(receiver, children, done, listener)
        finally:
            _end(children)
    return tuple(done[seed] for seed in sorted(done))


def _hear(
    receiver: connection.Connection,
    children: dict[connection.Connection, _Child],
    done: dict[int, TimedRun],
    listener: Listener,
) -> None:
    """Take one message of a child; a finished one moves from ``children`` to ``done``. Raises SeedError."""
    child = children[receiver]
    try:
        message: int | TimedRun | _Failure = receiver.recv()
    except (EOFError, OSError):
        how = how_it_ended(child.process)
        raise SeedError(f"seed {child.seed}: its process ended without a result, {how}") from None
    if isinstance(message, _Failure):
        raise SeedError(f"seed {child.seed}: {message.message}")
    if isinstance(message, int):
        listener.advanced(child.seed, message)
        return
    done[child.seed] = message
    _end({receiver: children.pop(receiver)}, GRACE_S)
    listener.finished(child.seed)


def _start(
    definition: Definition, seed: int, episodes: int, skill: NamedSkill | None, swaps: Sequence[Swap]
) -> tuple[connection.Connection, _Child]:
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(sender, definition, seed, episodes, skill, swaps), daemon=True)
    try:
        start(process)
    except OSError as error:
        raise SeedError(f"seed {seed}: its process could not be started: {error.strerror}") from error
    sender.close()
    return receiver, _Child(seed, process)


def _work(
    sender: connection.Connection,
    definition: Definition,
    seed: int,
    episodes: int,
    skill: NamedSkill | None,
    swaps: Sequence[Swap],
) -> None:
    """Run one seed in a child and send the number of episodes after each, at the end the result or the failure."""
    message: TimedRun | _Failure
    try:
        message = run_seed(definition, seed, episodes, sender.send, skill, swaps)
    except BrokenPipeError:
        return  # the parent is gone, nobody waits for this run
    except TreenailError as error:
        message = _Failure(_one_line(str(error)))
    except Exception as error:  # whatever it is, the parent has to name the seed
        message = _Failure(_one_line(f"{type(error).__name__}: {error}"))
    with sender, suppress(BrokenPipeError):
        sender.send(message)


def _end(children: dict[connection.Connection, _Child], grace_s: float = 0.0) -> None:
    """Make sure that children have ended: those that have not by themselves are terminated, then killed."""
    for child in children.values():
        child.process.join(grace_s)
        if child.process.is_alive():
            child.process.terminate()
    for receiver, child in children.items():
        child.process.join(GRACE_S)
        if child.process.is_alive():
            child.process.kill()
        child.process.join()
        child.process.close()
        receiver.close()


def _one_line(text: str) -> str:
    return " ".join(text.split())
