"""Gullapalli's stochastic real-valued units as a learner of moves (thesis 2.4 to 2.6; there "SRV").

One unit an axis that may move. Of an input x each draws its output from a normal distribution of mean theta . x and
standard deviation s(phi . x), where phi . x is the reinforcement that is expected; theta moves towards what earned
more than expected, and away from what earned less:

    theta += alpha (r - phi . x) (o - theta . x) / sigma x        phi += beta (r - phi . x) x

All units hear the same reinforcement and begin alike, so that their phi is one. Gullapalli put two layers of
back-propagating units before them; here x is made of the wrench by hand, and there is one layer. His reinforcement
took the distance from the goal, that is the pose; here it is the reward of the task, squeezed into 0 to 1.

A pure fold without BLAS: sums are in a fixed order, draws are by episode and step. What it learns from is the move
that was made, after it was cut and shortened to its bounds.
"""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Mapping
from typing import Annotated

from msgspec import Meta

from services.rules.bounds import Bounds
from services.rules.plugins import Lesson, Proposal, settings_as
from services.rules.wrench import Wrench
from services.wire.actions import Increment
from services.wire.definition import Setting
from services.wire.definition_base import Checked, Fraction
from services.wire.randomness import Draws, Role

INPUTS = 14
"""1; the wrench's direction times its bounded size, 6 components; that size; the components' magnitudes."""
LARGEST_N = 1e6
"""A component beyond this is no force that anything is learnt from."""
_SMALLEST_N = 1e-6
"""Added to the size of a wrench, so that none is without a direction."""


class SrvSettings(Checked, frozen=True, kw_only=True):
    """Settings of the units."""

    alpha: Fraction = 0.05
    """Learning rate of the mean (eq. 2.5)."""
    beta: Fraction = 0.05
    """Learning rate of the expected reinforcement (eq. 2.6)."""
    spread: Annotated[float, Meta(gt=0, le=1)] = 0.5
    """Standard deviation where no reinforcement is expected, as a part of half the way between an axis' bounds."""
    spread_least: Annotated[float, Meta(gt=0, le=1)] = 0.05
    """Least standard deviation: that of the thesis goes to 0, where nothing is tried any more."""
    torque_per_m: Annotated[float, Meta(ge=0, le=1000)] = 20.0
    """How many newtons a newton metre counts as, its torque referred as ``felt`` says."""
    unit_n: Annotated[float, Meta(gt=0, le=1000)] = 3.0
    """Scale of the inputs: about the force at which things change."""
    reward_unit: Annotated[float, Meta(gt=0, le=1e6)] = 10.0
    """Scale of rewards: one of so much up is a reinforcement of 3/4, so much down of 1/4; 0 is 1/2."""


class Srv:
    """The units of one run; see ``services.rules.plugins.ContinuousLearner`` for what it promises."""

    def __init__(self, bounds: Bounds, settings: Mapping[str, Setting], seed: int) -> None:
        """Start with means of 0, the middle between the bounds; ValueError for settings that are none."""
        self._settings = settings_as(SrvSettings, settings)
        self._bounds = bounds
        self._draws = Draws(seed, Role.POLICY)
        self._theta = [[0.0] * INPUTS for _ in bounds.axes]
        self._phi = [0.0] * INPUTS
        self._version = 0
        self.episodes_before = 0
        """Nothing here fades with episodes."""

    @property
    def states(self) -> int:
        """Nothing is kept by states."""
        return 0

    @property
    def version(self) -> int:
        """Number of updates so far."""
        return self._version

    def decide_move(self, previous: Lesson | None, state: int, felt: Wrench, episode: int, step: int) -> Increment:
        """Learn from ``previous``, which led to here, and return the move to make; see ``ContinuousLearner``."""
        if episode < 0 or step < 0:
            raise ValueError(f"episode and step: expected 0 or more, got {episode} and {step}")
        x = self._inputs(felt)
        if previous is not None:
            self._learn(previous)
        sigma = self._spread(_dot(self._phi, x))
        drawn = self._draws.at(episode, step).standard_normal(len(self._theta)).tolist()
        return self._bounds.within(
            [_cut(_dot(theta, x) + sigma * z) for theta, z in zip(self._theta, drawn, strict=True)]
        )

    def finish_move(self, previous: Lesson) -> None:
        """Learn from the last decision of an episode; too many moves without progress are none of its doing."""
        if previous.outcome != "no_progress":
            self._learn(previous)

    def proposal(self, state: int, felt: Wrench, episode: int) -> Proposal:
        """Return the means, and what is expected of them; see ``ContinuousLearner``."""
        x = self._inputs(felt)
        expected = _dot(self._phi, x)
        sigma, spread = self._spread(expected), [0.0] * len(Increment._fields)
        for axis in self._bounds.axes:
            spread[axis] = sigma * (self._bounds.high[axis] - self._bounds.low[axis]) / 2.0
        increment = self._bounds.within([_cut(_dot(theta, x)) for theta in self._theta])
        return Proposal(increment, Increment(*spread), expected)

    def snapshot(self) -> dict[str, bytes | int]:
        """Return theta, row by row, and phi as little-endian f64, with the counts."""
        numbers = [value for row in (*self._theta, self._phi) for value in row]
        weights = struct.pack(f"<{len(numbers)}d", *numbers)
        return {"states": 0, "version": self._version, "units": len(self._theta), "weights": weights}

    def restore(self, snapshot: Mapping[str, bytes | int]) -> None:
        """Take over a ``snapshot``, to the last bit. ValueError, with nothing changed, when it does not fit."""
        expected = {"states", "version", "units", "weights"}
        if set(snapshot) != expected:
            raise ValueError(f"snapshot: expected the fields {sorted(expected)}, got {sorted(snapshot)}")
        version, units, weights = snapshot["version"], snapshot["units"], snapshot["weights"]
        if not isinstance(version, int) or version < 0 or units != len(self._theta) or snapshot["states"] != 0:
            raise ValueError(f"snapshot: expected {len(self._theta)} units and no states, got {units!r}")
        count = (len(self._theta) + 1) * INPUTS
        if not isinstance(weights, bytes) or len(weights) != 8 * count:
            raise ValueError(f"snapshot: expected weights to be {8 * count} bytes, got others")
        numbers = struct.unpack(f"<{count}d", weights)
        if not all(map(math.isfinite, numbers)):
            raise ValueError("snapshot: expected finite weights, got others")
        rows = [list(numbers[start : start + INPUTS]) for start in range(0, count, INPUTS)]
        self._theta, self._phi, self._version = rows[:-1], rows[-1], version

    def digest(self) -> str:
        """Return the SHA-256, in hex, of the weights: equal for equal memories."""
        weights = self.snapshot()["weights"]
        assert isinstance(weights, bytes)
        return hashlib.sha256(b"srv" + weights).hexdigest()

    def _learn(self, lesson: Lesson) -> None:
        """Learn what a move earned. Raises ValueError, with nothing changed, for what cannot be learnt from."""
        if lesson.increment is None or not math.isfinite(lesson.reward):
            raise ValueError(f"lesson: expected a move and a finite reward, got {lesson.increment}, {lesson.reward}")
        settings, x = self._settings, self._inputs(lesson.felt)
        expected = _dot(self._phi, x)
        error, sigma = _squeezed(lesson.reward / settings.reward_unit) - expected, self._spread(expected)
        made = self._bounds.parts_of(lesson.increment)
        for theta, part in zip(self._theta, made, strict=True):
            rate = settings.alpha * error * (part - _dot(theta, x)) / sigma
            theta[:] = [weight + rate * value for weight, value in zip(theta, x, strict=True)]
        self._phi = [weight + settings.beta * error * value for weight, value in zip(self._phi, x, strict=True)]
        self._version += 1

    def _spread(self, expected: float) -> float:
        """Return s(r): less, the more reinforcement is expected (thesis 2.4)."""
        settings = self._settings
        return max(settings.spread_least, settings.spread * (1.0 - min(1.0, max(0.0, expected))))

    def _inputs(self, felt: Wrench) -> list[float]:
        """Return x, shape (INPUTS,). Raises ValueError for forces that are none."""
        gain, (force, torque) = self._settings.torque_per_m, felt
        components = (*force, gain * torque[0], gain * torque[1], gain * torque[2])
        if not all(abs(component) <= LARGEST_N for component in components):
            raise ValueError(f"force and torque: expected numbers within {LARGEST_N:g}, got {components}")
        total = 0.0
        for component in components:
            total += component * component
        size = math.sqrt(total) + _SMALLEST_N
        bounded = size / (size + self._settings.unit_n)
        directions = [component / size for component in components]
        return [1.0, *(bounded * value for value in directions), bounded, *map(abs, directions)]


def _dot(weights: list[float], x: list[float]) -> float:
    """Return the sum of products, in order."""
    total = 0.0
    for weight, value in zip(weights, x, strict=True):
        total += weight * value
    return total


def _cut(part: float) -> float:
    """Return an output that a move can have: beyond a bound it is the bound."""
    return min(1.0, max(-1.0, part))


def _squeezed(value: float) -> float:
    """Return a reward as a reinforcement, 0 to 1; a quotient, so that it is the same everywhere."""
    return (1.0 + value / (1.0 + abs(value))) / 2.0
