"""Fuzzy ART, a cheaper classifier than ART2 (thesis 7.4; Carpenter, Grossberg and Rosen 1991).

A class is a box in the space of force/torque directions. A presentation looks for the class whose box it enlarges
least, and takes it if the box then still is small enough (vigilance); the box grows to hold it. There is nothing to
settle, so that a presentation is a few operations on one array.

Where the paper leaves room: inputs must lie in [0, 1], so each component u of the unit vector becomes (1 + u) / 2,
followed by its complement, twelve inputs in all. Ties go to the older class.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from services.classifier import memory
from services.classifier.encoding import encode
from services.rules.plugins import Classification, ClassifierFullError, settings_as
from services.wire.definition import Setting

_COMPONENTS = 6
_INPUTS = 2 * _COMPONENTS


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the plug-in ``fuzzy-art``; names are the paper's."""

    rho: Annotated[float, msgspec.Meta(gt=0, lt=1)] = 0.85
    """Vigilance: a box has at most 6 (1 - rho) in all its sides together, each axis being 1 long."""
    alpha: Annotated[float, msgspec.Meta(gt=0, le=10)] = 0.001
    """Choice parameter; near 0 the smallest box that changes least is chosen."""
    beta: Annotated[float, msgspec.Meta(gt=0, le=1)] = 1.0
    """Learning rate; 1 makes the box grow at once."""
    torque_gain_per_m: Annotated[float, msgspec.Meta(ge=0, le=1000)] = 10.0
    """Factor from N m to input units, forces being in N."""
    capacity: Annotated[int, msgspec.Meta(ge=1, le=10000)] = 200
    """Most classes there can be; then an input that fits none is refused."""


class FuzzyArt:
    """A Fuzzy ART module. See ``services.rules.plugins.Classifier`` for what its methods promise."""

    encoding = "complement"

    def __init__(self, settings: Mapping[str, Setting]) -> None:
        """Make a module without classes. Raises ValueError for wrong settings."""
        self._settings = settings_as(Settings, settings)
        self._weights = np.zeros((0, _INPUTS))
        self._counts = np.zeros(0, np.int64)

    @property
    def states(self) -> int:
        """Number of classes."""
        return len(self._counts)

    @property
    def prototypes(self) -> NDArray[np.float64]:
        """Copy of the weights, shape (states, 12): lower corner of each box and one minus its upper corner."""
        return self._weights.copy()

    @property
    def counts(self) -> NDArray[np.int64]:
        """Copy of the presentations that each class has learnt, shape (states,)."""
        return self._counts.copy()

    def learn(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> Classification:
        """Classify one vector [N], [N m] and learn it; make a class if none fits."""
        stimulus = self._stimulus(force_n, torque_nm)
        unit, match = self._search(stimulus)
        new = unit < 0
        if new:
            if self.states == self._settings.capacity:
                raise ClassifierFullError(
                    f"classes: expected at most {self._settings.capacity} (capacity), got one more"
                )
            unit, match = self.states, 1.0
            self._weights = np.vstack([self._weights, stimulus])
            self._counts = np.append(self._counts, 0)
        beta, old = self._settings.beta, self._weights[unit]
        self._weights[unit] = beta * np.minimum(stimulus, old) + (1.0 - beta) * old
        self._counts[unit] += 1
        return Classification(unit, self.states, match, new)

    def classify(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> Classification:
        """Classify one vector [N], [N m] and change nothing."""
        unit, match = self._search(self._stimulus(force_n, torque_nm))
        return Classification(unit, self.states, match, False)

    def snapshot(self) -> dict[str, bytes | int]:
        """Return all that was learnt."""
        return memory.pack(self._weights, self._counts)

    def restore(self, snapshot: Mapping[str, bytes | int]) -> None:
        """Take over a snapshot. Raises ValueError."""
        weights, counts = memory.unpack(snapshot, (self._settings.capacity, _INPUTS), "Fuzzy ART")
        if not ((weights >= 0.0) & (weights <= 1.0)).all():
            raise ValueError("Fuzzy ART snapshot weights: expected numbers from 0 to 1, got others")
        self._weights, self._counts = weights, counts

    def digest(self) -> str:
        """Return the SHA-256, in hex, of the classes."""
        return memory.digest(self._weights, self._counts)

    def _stimulus(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> NDArray[np.float64]:
        """Return the complement-coded direction, shape (12,). Raises ValueError."""
        components = encode(force_n, torque_nm, self._settings.torque_gain_per_m, "odd")
        unit = components / np.sqrt((components * components).sum())
        half = (1.0 + unit) / 2.0
        return np.concatenate([half, 1.0 - half])

    def _search(self, stimulus: NDArray[np.float64]) -> tuple[int, float]:
        """Return the class that fits, -1 if none does, and its match, the best one's if none fits."""
        if not self.states:
            return -1, 0.0
        common = np.minimum(stimulus, self._weights).sum(axis=1)
        match = common / _COMPONENTS
        choice = common / (self._settings.alpha + self._weights.sum(axis=1))
        fitting = np.where(match >= self._settings.rho, choice, -1.0)
        unit = int(fitting.argmax())
        return (unit, float(match[unit])) if fitting[unit] >= 0.0 else (-1, float(match.max()))
