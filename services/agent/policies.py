"""How the agent chooses among actions of known value: greedy, epsilon-greedy and Gibbs softmax (thesis 4.2.1).

Pure functions of their arguments. The random number comes in as an argument, so that whoever calls decides what it
depends on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.wire.definition import EpsilonAnnealed, EpsilonGreedy, Greedy, Policy, Softmax


def probabilities(values: NDArray[np.float64], policy: Policy, episode: int) -> NDArray[np.float64]:
    """Return the probability of each action, shape (actions,), each in 0..1, their sum 1 up to rounding.

    ``values`` are the action values of one state, shape (actions,), finite; ``episode`` counts from 0. Actions that
    share the highest value share the greedy probability evenly (thesis eqs. 4.1 to 4.3). ValueError when ``values``
    is not such a row or ``episode`` is negative.
    """
    if values.ndim != 1 or values.size == 0 or not np.isfinite(values).all():
        raise ValueError(f"action values: expected a row of one or more finite numbers, got {values!r}")
    if episode < 0:
        raise ValueError(f"episode: expected 0 or more, got {episode}")
    if isinstance(policy, Softmax):
        return _gibbs(values, policy.beta + policy.beta_per_episode * episode)
    return _epsilon_greedy(values, _epsilon(policy, episode))


def pick(chances: NDArray[np.float64], uniform: float) -> int:
    """Return the index that ``uniform``, in 0..1, falls on in the cumulative sum of ``chances``, shape (actions,).

    Never an index of chance 0, also where rounding leaves the sum short of ``uniform``. ValueError when ``uniform``
    is out of range.
    """
    if not 0.0 <= uniform <= 1.0:
        raise ValueError(f"uniform random number: expected 0 to 1, got {uniform}")
    # The first sum strictly above `uniform` belongs to an index that raised it, hence of chance above 0.
    index = int(chances.cumsum().searchsorted(uniform, side="right"))
    return index if index < chances.size else int(chances.nonzero()[0][-1])


def select(values: NDArray[np.float64], policy: Policy, episode: int, uniform: float) -> int:
    """Return the action drawn by ``uniform``, in 0..1, from ``probabilities(values, policy, episode)``.

    Raises ValueError as ``probabilities`` and ``pick`` do.
    """
    return pick(probabilities(values, policy, episode), uniform)


def _epsilon(policy: Greedy | EpsilonGreedy | EpsilonAnnealed, episode: int) -> float:
    """Part of the choices that are made blindly in ``episode``, in 0..1 (thesis eq. 4.2)."""
    match policy:
        case Greedy():
            return 0.0
        case EpsilonGreedy():
            return policy.epsilon
        case EpsilonAnnealed():
            return 1.0 / (policy.mu * episode + 1.0)


def _epsilon_greedy(values: NDArray[np.float64], epsilon: float) -> NDArray[np.float64]:
    """Thesis eq. 4.1: 1 - epsilon + epsilon / |A| for the best action, epsilon / |A| for each other one."""
    best = values == values.max()
    chances: NDArray[np.float64] = epsilon / values.size + (1.0 - epsilon) * best / np.count_nonzero(best)
    return chances


def _gibbs(values: NDArray[np.float64], beta: float) -> NDArray[np.float64]:
    """Thesis eq. 4.3, with the best value subtracted first so that no exponential overflows."""
    # Halves: the difference of two doubles can overflow, that of their halves cannot, so beta = 0 stays uniform.
    behind = values / 2.0 - values.max() / 2.0
    with np.errstate(over="ignore"):  # beta times a distance may reach -inf, which is a chance of exactly 0
        weights = np.exp(2.0 * beta * behind)
    chances: NDArray[np.float64] = weights / weights.sum()
    return chances
