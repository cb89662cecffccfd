"""ART2's arithmetic, compiled: layers F0 and F1, the winner-take-all of F2, the orienting subsystem, learning.

Numbers in brackets are equations of the thesis (Appendix D, 4.3.2). Every function works on arrays of its caller and
keeps nothing. A layer is an array of shape (6, n) with one row per sublayer, see ``W`` to ``Q``.

Loops, sums and divisions are written out, and fast-math is off: the order of every operation is fixed, so equal
inputs give equal bits in every process.
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
    machine_code: ModuleType | None = import_module("services.classifier.art2_machine_code")
except ModuleNotFoundError:
    machine_code = None

Array = NDArray[np.float64]
Function = TypeVar("Function", bound=Callable[..., object])

W, X, V, U, P, Q = range(6)
SUBLAYERS = 6

TOLERANCE = 1e-10
"""A layer has settled when no component of u changed by more than this in one pass."""
PASSES = 200
"""Most passes through a layer; activities that have not settled by then are used as they are."""

NO_UNIT = -1
"""Answer of ``search``: no committed unit fits."""
SILENT = -2
"""Answer of ``search``: no component of the input passed the threshold."""


def _compiled(function: Function) -> Function:
    return compiled(function, machine_code)


@_compiled
def signal(activity: float, theta: float) -> float:
    """Threshold-linear f, continued odd-symmetrically; on activities that are never negative it is the thesis's f."""
    return activity if activity > theta or activity < -theta else 0.0


@_compiled
def norm_of(vector: Array) -> float:
    """Euclidean norm, summed in index order."""
    total = 0.0
    for i in range(vector.shape[0]):
        total += vector[i] * vector[i]
    return math.sqrt(total)


@_compiled
def normalise(layer: Array, source: int, target: int, e: float) -> None:
    """Row ``target`` = row ``source`` / (e + its norm); a zero row stays zero even where e is 0."""
    divisor = e + norm_of(layer[source])
    for i in range(layer.shape[1]):
        layer[target, i] = layer[source, i] / divisor if divisor > 0.0 else 0.0


@_compiled
def one_pass(
    layer: Array, stimulus: Array, top_down: Array, output: float, a: float, b: float, e: float, theta: float
) -> float:
    """One pass through a layer's sublayers in the thesis's sequence; returns the largest change of a u component.

    F1 is (D.7) to (D.12) with stimulus q' and ``top_down`` = z_J, ``output`` = g(y_J) = d. F0 is (D.1) to (D.6), the
    same equations with stimulus I and ``output`` 0: x and p do not depend on each other, so their order is free.
    """
    for i in range(layer.shape[1]):
        layer[W, i] = stimulus[i] + a * layer[U, i]  # (D.1) (D.7)
        layer[P, i] = layer[U, i] + output * top_down[i]  # (D.3) (D.8)
    normalise(layer, W, X, e)  # (D.2) (D.9)
    normalise(layer, P, Q, e)  # (D.4) (D.10)
    for i in range(layer.shape[1]):
        layer[V, i] = signal(layer[X, i], theta) + b * signal(layer[Q, i], theta)  # (D.5) (D.11)
    # (D.6) (D.12), written out because the change against the previous pass is wanted too
    divisor = e + norm_of(layer[V])
    change = 0.0
    for i in range(layer.shape[1]):
        fresh = layer[V, i] / divisor if divisor > 0.0 else 0.0
        change = max(change, abs(fresh - layer[U, i]))
        layer[U, i] = fresh
    return change


@_compiled
def settle(
    layer: Array, stimulus: Array, top_down: Array, output: float, a: float, b: float, e: float, theta: float
) -> int:
    """Repeat ``one_pass`` until u moves by at most ``TOLERANCE``, at most ``PASSES`` times; returns the passes made."""
    for made in range(1, PASSES + 1):
        if one_pass(layer, stimulus, top_down, output, a, b, e, theta) <= TOLERANCE:
            return made
    return PASSES


@_compiled
def match_of(priming: Array, p: Array, c: float, e: float) -> float:
    """Norm of the reset vector r (D.13), in [0, 1]; 1 when priming and expectation point the same way.

    (D.13) is printed with q of F1 in place of q' of F0. But q is p normalised (D.10), so that r would always have
    norm 1 and nothing could ever be reset; the bottom-up priming that the text speaks of is q', F1's input.
    """
    total = 0.0
    for i in range(p.shape[0]):
        component = priming[i] + c * p[i]
        total += component * component
    # The triangle inequality bounds the quotient by 1; only rounding can carry it above.
    return min(1.0, math.sqrt(total) / (e + norm_of(priming) + c * norm_of(p)))


@_compiled
def search(
    stimulus: Array,
    weights: Array,
    units: int,
    f0: Array,
    f1: Array,
    f2: Array,
    a: float,
    b: float,
    c: float,
    d: float,
    e: float,
    theta: float,
    rho: float,
) -> tuple[int, int, float]:
    """Present one input: settle F0 and F1, then let F2 and the orienting subsystem look for a unit that fits.

    Args:
        stimulus: I, shape (n,).
        weights: z, shape (capacity, n), of which the first ``units`` rows are committed.
        units: number of committed units.
        f0: layer F0, shape (6, n), overwritten.
        f1: layer F1, shape (6, n), overwritten; afterwards it is settled under the unit found, or without one.
        f2: T_j, shape (capacity,), overwritten; minus infinity where a unit was inhibited.
        a, b, c, d, e, theta, rho: parameters of ``Art2Settings``.

    Returns:
        The unit that fits, or ``NO_UNIT`` or ``SILENT``; the committed unit with the best match (the same one if it
        fits, -1 without any); its match.
    """
    f0[:] = 0.0
    f1[:] = 0.0
    settle(f0, stimulus, stimulus, 0.0, a, b, e, theta)
    settle(f1, f0[Q], stimulus, 0.0, a, b, e, theta)
    if norm_of(f1[U]) == 0.0:
        return SILENT, -1, 0.0
    for j in range(units):
        f2[j] = 0.0
        for i in range(stimulus.shape[0]):
            f2[j] += f1[P, i] * weights[j, i]  # (4.13)
    primed = f1[U].copy()
    nearest, best = -1, -1.0
    for _ in range(units):
        winner = 0
        for j in range(1, units):
            if f2[j] > f2[winner]:  # (4.14); the lowest number wins a tie
                winner = j
        f1[U] = primed
        settle(f1, f0[Q], weights[winner], d, a, b, e, theta)
        match = match_of(f0[Q], f1[P], c, e)
        # An uncommitted unit has T = 0, its weights being 0, and so wins over every unit that is not above that.
        if f2[winner] > 0.0 and match + e >= rho:
            return winner, winner, match
        if match > best:
            nearest, best = winner, match
        f2[winner] = -math.inf  # reset: inhibited for the rest of this presentation
    f1[U] = primed
    settle(f1, f0[Q], stimulus, 0.0, a, b, e, theta)
    return NO_UNIT, nearest, max(best, 0.0)


@_compiled
def learn(weights: Array, unit: int, u: Array, d: float, rate: float) -> None:
    """Move row ``unit`` of the weights by ``rate`` of the way to the learning law's equilibrium u / (1 - d)."""
    for i in range(u.shape[0]):
        weights[unit, i] += rate * (u[i] / (1.0 - d) - weights[unit, i])


@_compiled
def present(
    stimulus: Array, weights: Array, units: int, layers: Array, f2: Array, parameters: Array, rate: float
) -> tuple[int, int, float]:
    """Present one input, and learn it: all of a presentation in one call, as calls cost more than what they do.

    Args:
        stimulus, weights, units, f2: as in ``search``; the unit found learns, or the next one is committed.
        layers: F0 and F1, shape (2, 6, n), overwritten.
        parameters: a, b, c, d, e, theta, rho.
        rate: learning rate; 0 only to classify.

    Returns:
        As ``search``; but with the unit just committed, ``units``, and its own match, where none fits and one is left.
    """
    a, b, c, d = parameters[0], parameters[1], parameters[2], parameters[3]
    e, theta, rho = parameters[4], parameters[5], parameters[6]
    f0, f1 = layers[0], layers[1]
    unit, nearest, match = search(stimulus, weights, units, f0, f1, f2, a, b, c, d, e, theta, rho)
    if rate > 0.0 and unit == NO_UNIT and units < weights.shape[0]:
        match = match_of(f0[Q], f1[P], c, e)
        learn(weights, units, f1[U], d, 1.0)
        return units, nearest, match
    if rate > 0.0 and unit >= 0:
        learn(weights, unit, f1[U], d, rate)
    return unit, nearest, match
