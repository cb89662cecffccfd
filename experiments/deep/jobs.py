"""The runs of the deep learners: each is a job that a process does, and whose result is kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium
import msgspec

from experiments.deep.libraries import versions
from experiments.deep.methods import Method
from experiments.leaderboard.jobs import TASK, Outcome
from experiments.leaderboard.suite import moves_expected
from experiments.reproduce.code import code_sha256
from services.wire.definition import Definition
from services.wire.definition_file import definition_sha256

KIND = "deep run"
FROZEN = 20
"""Episodes after the last that is learnt from, in which the best known action is made and nothing is learnt."""
VERSION = 1
"""Goes up when ``learner.py`` or ``episodes.py`` changes what comes out."""
_MS = {"DQN": 1.5, "PPO": 1.5, "SAC": 9.0, "RecurrentPPO": 6.0}
"""About how long a decision takes, learning included, so that the time left can be told."""
_MOVES = 2.0
"""How many times as many moves as an insertion that goes well a learner takes, over a run."""

Make = Callable[..., gymnasium.Env[Any, Any]]
"""Makes the environment: of a ``definition``, ``continuous`` or not, with a ``history``."""


class Environment(NamedTuple):
    """Where the learners learn."""

    make: Make
    packages: tuple[str, ...]
    """Whose code decides what it does, beside the task's and the simulator's."""


class Place(NamedTuple):
    """Where a result stands."""

    task: str
    method: str
    seed: int
    episodes: int


class Job(msgspec.Struct, frozen=True, eq=False):
    """One run."""

    task: str
    method: Method
    definition: Definition
    seed: int
    episodes: int

    @property
    def place(self) -> Place:
        """Where its result stands in the study."""
        return Place(self.task, self.method.name, self.seed, self.episodes)

    @property
    def name(self) -> str:
        """What people call the job."""
        return f"{self.task}, {self.method.name}, seed {self.seed}, {self.episodes} episodes"

    @property
    def cost_s(self) -> float:
        """About how long it takes."""
        return self.episodes * moves_expected(self.definition) * _MOVES * _MS[self.method.algorithm] / 1000


class Learnt(msgspec.Struct, frozen=True):
    """What came of a job."""

    outcome: Outcome
    """Of the episodes that were learnt from, exploration on."""
    frozen: Outcome
    """Of ``FROZEN`` more, as learnt."""
    decisions: int
    """That were learnt from."""


class Order(NamedTuple):
    """A job and where it is done, as a process gets it."""

    job: Job
    environment: Environment


def key(job: Job, environment: Environment) -> dict[str, Any]:
    """Return all that the outcome of a job depends on; the method's name is none of it."""
    method = msgspec.to_builtins(job.method)
    del method["name"]
    return {
        "version": VERSION,
        "method": method,
        "definition": definition_sha256(job.definition),
        "seed": job.seed,
        "episodes": job.episodes,
        "libraries": versions(),
        "code": code_sha256((*TASK, *environment.packages)),
    }
