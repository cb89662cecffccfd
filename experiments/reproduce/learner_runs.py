"""The runs behind the chapter on learners: maze, cliff, and Gymnasium's cliff, all through the service's learner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from experiments.reproduce.gridworlds import CLIFF, MAZES, GridWorld, Move, World, greedy_path, train
from services.agent.learning import Learner
from services.wire.definition import TD_LEARNERS, EpsilonAnnealed, EpsilonGreedy, Policy, Softmax

Kind = Literal["sarsa", "q_learning"]
KINDS: tuple[Kind, ...] = ("sarsa", "q_learning")
POLICIES: dict[str, Policy] = {
    **{f"μ = {mu:g}": EpsilonAnnealed(mu=mu) for mu in (0.001, 0.01, 0.1, 1.0)},
    **{f"β = {beta:g}": Softmax(beta=beta, beta_per_episode=0.0) for beta in (1.0, 2.0, 5.0)},
}
"""The columns of Tables 4.1 and A.1."""
STATES = 16
CIRCLES = 100
"""Moves after which a greedy walk is taken to run in circles."""


Place = Literal["maze narrow", "maze wide", "cliff", "CliffWalking-v1"]


@dataclass(frozen=True)
class Run:
    """What a run depends on."""

    world: Place
    sees: Literal["walls", "square"]
    """What the state tells; always the square in CliffWalking-v1."""
    kind: Kind
    policy: str
    """One of POLICIES, or ``ε = 0.1``."""
    alpha: float
    gamma: float
    episodes: int
    seed: int
    version: int = 1


@dataclass(frozen=True)
class Learnt:
    """What came of a run."""

    returns: list[float]
    """Of each episode, undiscounted."""
    falls: list[int]
    """The episodes that ended over the edge."""
    best: str
    """The best-valued move of each of the 16 states, such as ``NEES...``; of squares told apart, empty."""
    path: str
    """The greedy path from the start, such as ``NEES``; a hundred moves when it runs in circles."""
    greedy_return: float
    """Sum of the rewards on that path."""


def learn(run: Run) -> Learnt:
    """Train a fresh learner as ``run`` says and walk greedily at the end."""
    world = _world(run)
    policy = POLICIES.get(run.policy, EpsilonGreedy(epsilon=0.1))
    learner = Learner(len(Move), TD_LEARNERS[run.kind](alpha=run.alpha, gamma=run.gamma), policy, run.seed)
    training = train(world, learner, run.episodes)
    path = [move for _, move in greedy_path(world, learner, CIRCLES)]
    best = [Move(learner.best_action(state)) for state in range(STATES)] if run.sees == "walls" else []
    return Learnt(
        training.returns.tolist(),
        np.flatnonzero(training.falls).tolist(),
        letters(best),
        letters(path),
        _return_of(world, path),
    )


def letters(moves: list[Move]) -> str:
    """Return moves as their initials."""
    return "".join(move.name[0] for move in moves)


def _world(run: Run) -> World:
    if run.world == "CliffWalking-v1":
        from experiments.reproduce.cliff_gym import CliffWalking

        return CliffWalking()
    return GridWorld(CLIFF if run.world == "cliff" else MAZES[run.world.removeprefix("maze ")], run.sees)


def _return_of(world: World, path: list[Move]) -> float:
    """Return the sum of the rewards of a walk from the start."""
    world.reset()
    return float(sum(world.step(move)[1] for move in path))
