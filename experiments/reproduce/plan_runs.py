"""The plan of 5.2.2: every learner with every way to choose, all else the same, and what is changed of all else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import NamedTuple

from msgspec.structs import replace

from experiments.reproduce.variants import Wanted
from services.wire.definition import (
    Art2Settings,
    Definition,
    EpsilonAnnealed,
    EpsilonGreedy,
    Policy,
    QLearning,
    Sarsa,
    Softmax,
    TdSettings,
)
from services.wire.definition_file import load

TASK = "chamfered-q-softmax"
"""The round peg and the chamfered hole: the plan's parts (5.2.2)."""
ALPHA, GAMMA, RHO = 0.1, 0.95, 0.94
"""One learning rate and one discount factor for all; the vigilance is the thesis's usual one."""
LEARNERS: Mapping[str, TdSettings] = {
    "Q-learning": QLearning(alpha=ALPHA, gamma=GAMMA),
    "SARSA": Sarsa(alpha=ALPHA, gamma=GAMMA),
}
POLICIES: Mapping[str, Policy] = {
    "softmax": Softmax(beta=4.0, beta_per_episode=0.3),
    "ε = 0.1": EpsilonGreedy(epsilon=0.1),
    "ε, schedule I": EpsilonAnnealed(mu=0.1),
    "ε, schedule II": EpsilonAnnealed(mu=0.01),
}
"""The conference paper's Policy II explores longer (3299); its curves are lost, so that equation 4.2 stands in."""
COLLISIONS_N = (10.0, 20.0)
"""Table B.1 (2849) and 5.3 (1832)."""
CENTRES_MM = (0.0, 130.0)
"""How far behind the tip rotations turn about: the tip, and the interface of the gripper (2959)."""


class Condition(NamedTuple):
    """What is one cell of the plan."""

    learner: str
    policy: str
    collision_n: float
    centre_mm: float

    @property
    def is_standard(self) -> bool:
        """Return whether all but learner and policy is as in the experiments of chapter 6 here."""
        return (self.collision_n, self.centre_mm) == (COLLISIONS_N[0], CENTRES_MM[0])

    @property
    def turns_about(self) -> str:
        """Return in a word what rotations turn about."""
        return "flange" if self.centre_mm else "tip"


CONDITIONS = tuple(
    Condition(learner, policy, collision_n, centre_mm)
    for centre_mm, collision_n, learner, policy in product(CENTRES_MM, COLLISIONS_N, LEARNERS, POLICIES)
)


def definition(condition: Condition) -> Definition:
    """Return the task of a condition."""
    task = at_limit(load(TASK), condition.collision_n)
    return replace(
        task,
        moves=replace(task.moves, rotation_centre_mm=condition.centre_mm),
        classifier=Art2Settings(rho=RHO),
        learner=LEARNERS[condition.learner],
        policy=POLICIES[condition.policy],
    )


def at_limit(task: Definition, collision_n: float) -> Definition:
    """Return a task whose collisions begin at another force; the guard beside the robot gives way at twice that."""
    limits = replace(task.limits, collision_force_n=collision_n, hard_force_n=2 * collision_n)
    return replace(task, limits=limits)


EPISODES, QUICK_EPISODES = 400, 4
"""As many as Fig. 6.7 shows."""
RANDOM_STARTS = "paper2-random-start"
"""The conference paper's task, on which its two schedules were compared."""
SCHEDULES: Mapping[str, EpsilonAnnealed] = {"I": EpsilonAnnealed(mu=0.1), "II": EpsilonAnnealed(mu=0.01)}


def of_plan(seeds: Sequence[int], episodes: int) -> list[Wanted]:
    """Return the plan's runs, all conditions of a seed and then the next: stopped early, some seeds are whole."""
    return [(definition(condition), seed, episodes) for seed in seeds for condition in CONDITIONS]


def of_schedules(seeds: Sequence[int], episodes: int) -> list[Wanted]:
    """Return the runs from random starts, both schedules of a seed and then the next."""
    task = load(RANDOM_STARTS)
    return [(replace(task, policy=policy), seed, episodes) for seed in seeds for policy in SCHEDULES.values()]
