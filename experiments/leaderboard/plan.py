"""Which runs a board consists of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from experiments.leaderboard.jobs import Job
from experiments.leaderboard.methods import Method, variant
from experiments.leaderboard.targets import Target, target_of
from services.wire.definition import Definition
from services.wire.errors import DefinitionError

EPISODES, QUICK_EPISODES = 300, 100
BASELINE_EPISODES, QUICK_BASELINE_EPISODES = 40, 20
"""Of who does not learn: all count, so fewer do."""
SEEDS, QUICK_SEEDS = tuple(range(100, 110)), (100, 101, 102)
"""Seeds that nobody tunes on: runs and tests use 0 to 9."""


class Length(NamedTuple):
    """How much is run."""

    seeds: tuple[int, ...]
    episodes: int
    baseline_episodes: int


class Entry(NamedTuple):
    """One method on one task: a row of the board, before it is run."""

    task: str
    method: Method
    jobs: tuple[Job, ...]
    refused: str = ""
    """Why the method cannot be tried on the task; there are no jobs then."""
    target: Target | None = None


def entries(tasks: Sequence[Definition], methods: Sequence[Method], length: Length) -> tuple[Entry, ...]:
    """Return the rows, task by task."""
    return tuple(_entry(task, method, length) for task in tasks for method in methods)


def _entry(task: Definition, method: Method, length: Length) -> Entry:
    try:
        definition = variant(task, method.overrides, f"{task.name}, {method.name}")
    except DefinitionError as error:
        return Entry(task.name, method, (), str(error))
    episodes = {"learn": length.episodes, "oracle": 1}.get(method.kind, length.baseline_episodes)
    jobs = tuple(Job(task.name, method.name, method.kind, definition, seed, episodes) for seed in length.seeds)
    return Entry(task.name, method, jobs, target=target_of(task.name) if method.kind == "learn" else None)
