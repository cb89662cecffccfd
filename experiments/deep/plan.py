"""Which runs the study consists of: deep learners, Treenail's own and the rules, on the same starts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from experiments.deep.jobs import Job
from experiments.deep.methods import TRIED, Method
from experiments.leaderboard import plan
from experiments.leaderboard.methods import TREENAIL, methods
from experiments.leaderboard.plan import Entry, Length
from services.wire.definition import Definition

SEEDS = (100, 101, 102)
"""Of the leaderboard's; nothing is tuned on them."""
TUNING_SEEDS = (5001, 5002)
EPISODES, TUNING_EPISODES = 300, 100


class Longer(NamedTuple):
    """One method on the first seed for more episodes: does it get there at last?"""

    method: Method
    episodes: int


class Study(NamedTuple):
    """All there is to run."""

    tasks: tuple[Definition, ...]
    methods: tuple[Method, ...]
    seeds: tuple[int, ...]
    episodes: int
    longer: Longer | None = None

    @property
    def length(self) -> Length:
        """The same, as the leaderboard counts it."""
        return Length(self.seeds, self.episodes, plan.BASELINE_EPISODES)

    def others(self) -> tuple[Entry, ...]:
        """Return the rows of Treenail's own learner, as the task comes with it, and of the rules."""
        return plan.entries(self.tasks, methods([TREENAIL]), self.length)

    def jobs(self) -> list[Job]:
        """Return the runs of the deep learners, those that are cheap first."""
        ours = [
            Job(task.name, method, task, seed, self.episodes)
            for task in self.tasks
            for method in self.methods
            for seed in self.seeds
        ]
        return sorted(ours, key=lambda job: job.cost_s)

    def longer_jobs(self) -> list[Job]:
        """Return the long run, on the first task; none where none was asked for."""
        if self.longer is None:
            return []
        task = self.tasks[0]
        return [Job(task.name, self.longer.method, task, self.seeds[0], self.longer.episodes)]


def tuning(task: Definition, wanted: Sequence[Method]) -> list[Job]:
    """Return the runs by which settings are chosen for the algorithms of some methods, as the library has them too."""
    algorithms = {method.algorithm for method in wanted}
    some = [method for method in TRIED if method.algorithm in algorithms]
    return [Job(task.name, method, task, seed, TUNING_EPISODES) for method in some for seed in TUNING_SEEDS]
