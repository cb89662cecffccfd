"""The felt model's arithmetic, compiled: features of a wrench, what each move is thought to earn, and the fit of it.

Every function works on arrays of its caller and keeps nothing. Sums and divisions are written out, fast-math is off,
and there is no BLAS: the order of every operation is fixed, so equal inputs give equal bits in every process, with
however wide registers. For the same reason tanh is a quotient of polynomials and not the library's.

A *line* is a direction of motion up to its sign: +X and -X are one. What opposite moves earn depends on a wrench in
opposite ways (``ODD`` features, times the move's signed size) and in the same way (``EVEN`` ones, times its size).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from services.rules.compiled import compiled

try:
    # Made ahead by compile_kernel.py, for container images: the compiler alone takes 190 MB.
    machine_code: ModuleType | None = import_module("services.agent.felt_machine_code")
except ModuleNotFoundError:
    machine_code = None

Array = NDArray[np.float64]
Function = TypeVar("Function", bound=Callable[..., object])

AXES = 6
"""Components of a wrench: three of the force [N], three of the torque, scaled to newtons."""
ODD = 3 * AXES
"""w/|w|, w/unit and tanh(|w|/unit) w/|w|."""
EVEN = 3 + AXES
"""1, |w|/unit, tanh(|w|/unit), and the magnitudes of the components of w/|w|."""
FEATURES = ODD + EVEN
_SMALLEST_N = 1e-6
"""Added to |w|, so that no wrench is without a direction."""


def _compiled(function: Function) -> Function:
    return compiled(function, machine_code)


@_compiled
def squash(x: float) -> float:
    """Tanh of ``x``, 0 or more, to 1e-4: a Pade approximant, at most 1."""
    y = x * x
    above = x * (135135.0 + y * (17325.0 + y * (378.0 + y)))
    below = 135135.0 + y * (62370.0 + y * (3150.0 + y * 28.0))
    return min(1.0, above / below)


@_compiled
def features(wrench: Array, unit_n: float, out: Array) -> None:
    """Write the features of a wrench, shape (6,), for a move of size 1 into ``out``, shape (FEATURES,)."""
    total = 0.0
    for i in range(AXES):
        total += wrench[i] * wrench[i]
    size = math.sqrt(total) + _SMALLEST_N
    bounded = squash(size / unit_n)
    out[ODD] = 1.0
    out[ODD + 1] = size / unit_n
    out[ODD + 2] = bounded
    for i in range(AXES):
        direction = wrench[i] / size
        out[i] = direction
        out[AXES + i] = wrench[i] / unit_n
        out[2 * AXES + i] = bounded * direction
        out[ODD + 3 + i] = abs(direction)


@_compiled
def sized(plain: Array, size: float, out: Array) -> None:
    """Write the features of a move of a signed size, 1 for the line's largest, into ``out``."""
    for i in range(ODD):
        out[i] = size * plain[i]
    for i in range(ODD, FEATURES):
        out[i] = abs(size) * plain[i]


@_compiled
def spread(covariance: Array, x: Array, out: Array) -> float:
    """Return x' P x, and write P x into ``out``; ``covariance`` is P, shape (FEATURES, FEATURES), symmetric."""
    for j in range(FEATURES):
        out[j] = 0.0
    for i in range(FEATURES):
        for j in range(FEATURES):
            out[j] += covariance[i, j] * x[i]
    total = 0.0
    for j in range(FEATURES):
        total += x[j] * out[j]
    return total


@_compiled
def judge(
    wrench: Array, unit_n: float, lines: NDArray[np.int64], sizes: Array, theta: Array, covariances: Array, out: Array
) -> None:
    """Write what each move is thought to earn, and the standard deviation of that, into ``out``, shape (2, actions).

    Args:
        wrench: shape (6,), in newtons.
        unit_n: scale of the features.
        lines: the line of each action, shape (actions,).
        sizes: its signed size, shape (actions,).
        theta: shape (lines, FEATURES).
        covariances: shape (lines, FEATURES, FEATURES).
        out: overwritten.
    """
    plain, x, px = np.empty(FEATURES), np.empty(FEATURES), np.empty(FEATURES)
    features(wrench, unit_n, plain)
    for action in range(lines.shape[0]):
        line = lines[action]
        sized(plain, sizes[action], x)
        mean = 0.0
        for i in range(FEATURES):
            mean += theta[line, i] * x[i]
        out[0, action] = mean
        out[1, action] = math.sqrt(max(0.0, spread(covariances[line], x, px)))


@_compiled
def fit(
    wrench: Array,
    unit_n: float,
    size: float,
    target: float,
    drift: float,
    most: float,
    theta: Array,
    covariance: Array,
) -> None:
    """Teach a line what a move of a signed size earned at a wrench: one step of recursive least squares.

    ``theta``, shape (FEATURES,), and ``covariance``, shape (FEATURES, FEATURES), are changed by the formula of Sherman
    and Morrison. Before it the covariance goes the part ``drift`` of the way back to what it was at first, ``most`` for
    each part of theta: what is long ago counts less, and what is never seen again is as unsure as it was at first, no
    more (a factor of forgetting would let it grow beyond all bounds).
    """
    plain, x, px = np.empty(FEATURES), np.empty(FEATURES), np.empty(FEATURES)
    features(wrench, unit_n, plain)
    sized(plain, size, x)
    if drift > 0.0:
        for i in range(FEATURES):
            for j in range(FEATURES):
                covariance[i, j] = covariance[i, j] * (1.0 - drift)
            covariance[i, i] = covariance[i, i] + drift * most
    scale = 1.0 / (1.0 + spread(covariance, x, px))
    mean = 0.0
    for i in range(FEATURES):
        mean += theta[i] * x[i]
    wrong = (target - mean) * scale
    for i in range(FEATURES):
        theta[i] += wrong * px[i]
        for j in range(FEATURES):
            covariance[i, j] -= (px[i] * px[j]) * scale  # this way round it stays symmetric to the last bit
