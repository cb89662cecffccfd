"""What maze, cliff and Gymnasium's cliff have in common in the chapter on learners."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from experiments.reproduce.context import Context
from experiments.reproduce.learner_runs import Kind, Learnt, Run, learn

GOAL = 14
"""The state at the goal, in both of the thesis's worlds."""
NAMES: dict[Kind, str] = {"sarsa": "SARSA", "q_learning": "Q-learning"}
CONSTANT = "ε = 0.1"
"""The policy of the cliffs."""

Runs: TypeAlias = Mapping[tuple[Kind, str], Sequence[Learnt]]
"""Runs by learner and policy, in the order of seeds."""


def learn_all(context: Context, what: str, runs: Sequence[Run]) -> Runs:
    """Return what came of runs; ``what`` says what they are in words, and names them in the cache."""
    done: dict[tuple[Kind, str], list[Learnt]] = {}
    for run, learnt in zip(runs, context.pieces(what, runs, learn, Learnt), strict=True):
        done.setdefault((run.kind, run.policy), []).append(learnt)
    return done


def returns(runs: Sequence[Learnt]) -> NDArray[np.float64]:
    """Return the returns of each episode, shape (runs, episodes)."""
    return np.array([run.returns for run in runs])


def most(letters: Sequence[str]) -> str:
    """Return the most frequent letter, with its share where it is not the only one: ``E``, ``E 7/10``."""
    letter, times = Counter(letters).most_common(1)[0]
    return letter if times == len(letters) else f"{letter} {times}/{len(letters)}"
