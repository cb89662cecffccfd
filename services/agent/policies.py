"""How the agent chooses among actions of known value: greedy, epsilon-greedy and Gibbs softmax (thesis 4.2.1).

Pure functions of their arguments. The random number comes in as an argument, so that whoever calls decides what it
depends on.

What is drawn is the same on every machine, though exponentials differ in their last bit between processors and
libraries: where that bit could matter, some 1 in 10**11 draws, ``choose`` works with 100 digits.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from decimal import Context, Decimal
from functools import lru_cache
from itertools import accumulate
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from services.wire.definition import EpsilonAnnealed, EpsilonGreedy, Exploring, Greedy, Policy, Softmax, Thompson

_CLOSE = 1e-12
"""Part of the whole within which a draw is not trusted to doubles; they err by less than a hundredth of it."""
_QUANTILES = 200
_NEVER = -700.0
"""Exponents below this are chances of exactly 0, as they nearly are in doubles."""
_DIGITS = Context(prec=100)


def probabilities(values: NDArray[np.float64], policy: Policy, episode: int) -> NDArray[np.float64]:
    """Return the probability of each action, shape (actions,), each in 0..1, their sum 1 up to rounding.

    ``values`` are the action values of one state, shape (actions,), finite; ``episode`` counts from 0. Actions that
    share the highest value share the greedy probability evenly (thesis eqs. 4.1 to 4.3). ValueError when ``values``
    is not such a row or ``episode`` is negative.
    """
    _check_row(values)
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
    _check_row(values)
    return choose(values.tolist(), policy, episode, uniform)


def choose(values: Sequence[float], policy: Policy, episode: int, uniform: float) -> int:
    """Return what ``select`` does for a row of one or more finite numbers; ValueError for the other arguments."""
    if not 0.0 <= uniform <= 1.0:
        raise ValueError(f"uniform random number: expected 0 to 1, got {uniform}")
    if episode < 0:
        raise ValueError(f"episode: expected 0 or more, got {episode}")
    best = max(values)
    if isinstance(policy, Softmax):
        half, doubled = best / 2.0, 2.0 * (policy.beta + policy.beta_per_episode * episode)  # see _gibbs
        return _drawn([doubled * (value / 2.0 - half) for value in values], uniform)
    epsilon = _epsilon(policy, episode)
    least = epsilon / len(values)
    most = least + (1.0 - epsilon) / values.count(best)
    sums = list(accumulate(most if value == best else least for value in values))
    index = bisect_right(sums, uniform)
    # Where rounding leaves the sum short: the last that has a chance.
    return index if index < len(sums) else bisect_left(sums, sums[-1])


def goes_on(policy: Policy, episode: int, uniform: float) -> bool:
    """Return whether exploration makes the last move again, whatever its value; ``uniform`` is a draw in 0..1."""
    return isinstance(policy, Exploring) and uniform < policy.repeat * faded(policy.repeat_fade, episode)


@lru_cache(maxsize=64)
def faded(rate: float, episode: int) -> float:
    """Return exp(-rate * episode), alike on every machine: it is worked out with more digits, once an episode."""
    return float((-Decimal(rate) * episode).exp(_DIGITS))


def best_chances(values: NDArray[np.float64], deviations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the chance of each of several independent normal variables to be the greatest, shape (actions,).

    They have these means and standard deviations, finite, the latter 0 or more. Where all are 0, those of the greatest
    mean share it. By ``_QUANTILES`` quantiles of each, so to about 1/200.
    """
    _check_row(values)
    if not deviations.any():
        return _epsilon_greedy(values, 0.0)
    normal = NormalDist()
    scores = [normal.inv_cdf((n + 0.5) / _QUANTILES) for n in range(_QUANTILES)]
    chances = np.zeros(values.size)
    for action, (mean, deviation) in enumerate(zip(values.tolist(), deviations.tolist(), strict=True)):
        for drawn in (mean + deviation * score for score in scores):
            chances[action] += math.prod(
                _below(drawn, other, wide)
                for number, (other, wide) in enumerate(zip(values.tolist(), deviations.tolist(), strict=True))
                if number != action
            )
    total = chances.sum()
    return chances / total if total > 0.0 else best_chances(values, np.zeros(values.size))


def _below(value: float, mean: float, deviation: float) -> float:
    """Return the chance that a normal variable is at most ``value``."""
    if deviation == 0.0:
        return float(mean <= value)
    return 0.5 * math.erfc((mean - value) / (deviation * math.sqrt(2.0)))


def _drawn(exponents: Sequence[float], uniform: float) -> int:
    """Return the index that ``uniform`` falls on when each weighs e to its exponent, of which the greatest is 0."""
    sums = list(accumulate(map(math.exp, exponents)))
    total = sums[-1]
    at, room = uniform * total, _CLOSE * total
    index = bisect_right(sums, at)
    if index < len(sums) and sums[index] - at > room and (index == 0 or at - sums[index - 1] > room):
        return index
    weights = [Decimal(value).exp(_DIGITS) if value >= _NEVER else Decimal(0) for value in exponents]
    exact = list(accumulate(weights, _DIGITS.add))
    index = bisect_right(exact, _DIGITS.multiply(Decimal(uniform), exact[-1]))
    return index if index < len(exact) else bisect_left(exact, exact[-1])


def _check_row(values: NDArray[np.float64]) -> None:
    if values.ndim != 1 or values.size == 0 or not np.isfinite(values).all():
        raise ValueError(f"action values: expected a row of one or more finite numbers, got {values!r}")


def _epsilon(policy: Greedy | EpsilonGreedy | EpsilonAnnealed | Thompson, episode: int) -> float:
    """Part of the choices that are made blindly in ``episode``, in 0..1 (thesis eq. 4.2)."""
    match policy:
        case Greedy() | Thompson():  # a table alone has nothing to draw values from
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
