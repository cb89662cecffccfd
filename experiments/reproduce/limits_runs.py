"""Tasks whose collision limit the thesis does not tell, at both limits that it names elsewhere; and without a rule."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

from msgspec.structs import replace

from experiments.reproduce.plan_runs import COLLISIONS_N, at_limit
from experiments.reproduce.variants import Wanted
from services.wire.definition import Definition
from services.wire.definition_file import load

EPISODES, QUICK_EPISODES = 600, 6
"""As many as the thesis shows of the square peg (2155)."""
CHAMFERLESS, SQUARE = "chamferless-q-softmax", "square-q-softmax"
TASKS = (CHAMFERLESS, "chamferless-q-egreedy", SQUARE)


class Condition(NamedTuple):
    """A task, and what is changed of it."""

    task: str
    collision_n: float
    rule: bool = True
    """Whether too many moves without progress end an episode with -50."""
    errors: bool = True
    """Whether sensor and arm have the errors that the thesis measured."""

    @property
    def is_usual(self) -> bool:
        """Return whether no more than the force of a collision is changed."""
        return self.rule and self.errors


CONDITIONS = (
    *(Condition(task, collision_n) for task, collision_n in product(TASKS, COLLISIONS_N)),
    *(Condition(CHAMFERLESS, collision_n, rule=False) for collision_n in COLLISIONS_N),
    *(Condition(SQUARE, collision_n, errors=False) for collision_n in COLLISIONS_N),
)


def definition(condition: Condition) -> Definition:
    """Return the task of a condition."""
    task = at_limit(load(condition.task), condition.collision_n)
    if not condition.rule:
        task = replace(task, limits=replace(task.limits, no_progress_moves=0))
    return task if condition.errors else replace(task, noise=replace(task.noise, scale=0.0))


def runs(seeds: Sequence[int], episodes: int) -> list[Wanted]:
    """Return the runs, all conditions of a seed and then the next: stopped early, some seeds are whole."""
    return [(definition(condition), seed, episodes) for seed in seeds for condition in CONDITIONS]
