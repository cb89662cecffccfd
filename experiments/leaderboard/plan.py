"""Which runs a board consists of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from experiments.evaluate.controllers import RANDOM, RULES
from experiments.leaderboard.jobs import Job
from experiments.leaderboard.methods import TREENAIL, Method, changed, learnt_before
from experiments.leaderboard.suite import SLOW_MOVES, moves_expected
from experiments.leaderboard.targets import Target, target_of
from services.rules.skill import SkillError
from services.wire.definition import Definition
from services.wire.errors import DefinitionError

EPISODES, QUICK_EPISODES = 300, 100
BASELINE_EPISODES, QUICK_BASELINE_EPISODES = 40, 20
"""Of who does not learn: all count, so fewer do."""
RANDOM_EPISODES = 10
"""Most episodes of random moves, which take longest and teach least."""
SLOW_SEEDS = 3
"""Where an insertion takes more than ``SLOW_MOVES``, all but learner and rule run on the first few seeds only."""
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
        definition = changed(task, method)
        skill = learnt_before(definition, method)
    except (DefinitionError, SkillError) as error:
        return Entry(task.name, method, (), str(error))
    baseline = min(length.baseline_episodes, RANDOM_EPISODES) if method.name == RANDOM else length.baseline_episodes
    episodes = {"learn": length.episodes, "oracle": 1}.get(method.kind, baseline)
    few = method.name not in (TREENAIL, *RULES) and moves_expected(task) > SLOW_MOVES
    seeds = length.seeds[:SLOW_SEEDS] if few else length.seeds
    jobs = tuple(Job(task.name, method.name, method.kind, definition, seed, episodes, skill) for seed in seeds)
    return Entry(task.name, method, jobs, target=target_of(task.name) if method.kind == "learn" else None)
