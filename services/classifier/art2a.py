"""ART2-A of the library artlib as a classifier: a plug-in that stands on somebody else's code.

ART2-A replaces ART2's settling by its result: unit vectors, a scalar product, and a step towards the input. The library
keeps the network; here F/T vectors become its inputs, and its weights the memory that a run is checkpointed by.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from services.classifier import memory
from services.classifier.encoding import encode
from services.rules.plugins import Classification, ClassifierFullError, settings_as
from services.wire.definition import Setting

_INPUTS = 12
_LONGEST = 1.0 + 1e-9
"""Weights are means of unit vectors; the rest is room for rounding."""


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the plug-in ``art2a``; names are the library's."""

    rho: Annotated[float, msgspec.Meta(gt=0, lt=1)] = 0.92
    """Vigilance: least scalar product of input and weights."""
    alpha: Annotated[float, msgspec.Meta(ge=0, le=0.28)] = 1e-7
    """Choice parameter."""
    beta: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.05
    """Learning rate."""
    torque_gain_per_m: Annotated[float, msgspec.Meta(ge=0, le=1000)] = 10.0
    """Factor from N m to input units, forces being in N."""
    capacity: Annotated[int, msgspec.Meta(ge=1, le=10000)] = 200
    """Most classes there can be; then an input that fits none is refused."""


class Art2A:
    """artlib's ART2A. See ``services.rules.plugins.Classifier`` for what its methods promise."""

    encoding = "split"

    def __init__(self, settings: Mapping[str, Setting]) -> None:
        """Make a network without classes. Raises ValueError for wrong settings, or without the library."""
        self._settings = settings_as(Settings, settings)
        self._network = _network(self._settings)
        self._weights: list[NDArray[np.float64]] = []
        self._counts: list[int] = []

    @property
    def states(self) -> int:
        """Number of classes."""
        return len(self._counts)

    @property
    def prototypes(self) -> NDArray[np.float64]:
        """Copy of the weights, shape (states, 12): positive parts of the six components, then negative parts."""
        return np.array(self._weights, dtype=np.float64).reshape(self.states, _INPUTS)

    @property
    def counts(self) -> NDArray[np.int64]:
        """Copy of the presentations that each class has learnt, shape (states,)."""
        return np.array(self._counts, dtype=np.int64)

    def learn(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> Classification:
        """Classify one vector [N], [N m] and learn it; make a class if none fits."""
        stimulus = self._stimulus(force_n, torque_nm)
        unit, match = self._search(stimulus)
        new = unit < 0
        if new:
            if self.states == self._settings.capacity:
                most = self._settings.capacity
                raise ClassifierFullError(f"classes: expected at most {most} (capacity), got an input that fits none")
            unit, match = self.states, 1.0
            self._weights.append(self._network.new_weight(stimulus, self._network.params))
            self._counts.append(0)
        else:
            self._weights[unit] = self._network.update(stimulus, self._weights[unit], self._network.params)
        self._counts[unit] += 1
        return Classification(unit, self.states, match, new)

    def classify(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> Classification:
        """Classify one vector [N], [N m] and change nothing."""
        unit, match = self._search(self._stimulus(force_n, torque_nm))
        return Classification(unit, self.states, match, False)

    def snapshot(self) -> dict[str, bytes | int]:
        """Return all that was learnt."""
        return memory.pack(self.prototypes, self.counts)

    def restore(self, snapshot: Mapping[str, bytes | int]) -> None:
        """Take over a snapshot. Raises ValueError."""
        weights, counts = memory.unpack(snapshot, (self._settings.capacity, _INPUTS), "ART2-A")
        norms = np.sqrt((weights * weights).sum(axis=1))
        if not ((weights >= 0.0).all() and ((norms > 0.0) & (norms <= _LONGEST)).all()):
            raise ValueError("ART2-A snapshot weights: expected rows of 0 or more with a norm up to 1, got others")
        self._weights, self._counts = list(weights), counts.tolist()

    def digest(self) -> str:
        """Return the SHA-256, in hex, of the classes."""
        return memory.digest(self.prototypes, self.counts)

    def _stimulus(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> NDArray[np.float64]:
        """Return the direction, signs apart, shape (12,), norm 1. Raises ValueError."""
        components = encode(force_n, torque_nm, self._settings.torque_gain_per_m, "split")
        unit: NDArray[np.float64] = components / np.sqrt((components * components).sum())
        return unit

    def _search(self, stimulus: NDArray[np.float64]) -> tuple[int, float]:
        """Return the class that fits best, -1 if none does, and its match, the best one's if none fits."""
        best, match = -1, 0.0
        for unit, weight in enumerate(self._weights):
            _, cache = self._network.category_choice(stimulus, weight, self._network.params)
            criterion, _ = self._network.match_criterion(stimulus, weight, self._network.params, cache)
            if criterion > match:
                best, match = unit, float(criterion)
        return (best if match >= self._settings.rho else -1), min(match, 1.0)


def _network(settings: Settings) -> Any:
    """Return the library's network. Raises ValueError when it is not installed."""
    with warnings.catch_warnings():
        # The library warns that ART2-A works badly on data of mixed signs; signs are apart here.
        warnings.simplefilter("ignore")
        try:
            from artlib import ART2A
        except ImportError as error:
            raise ValueError(f'expected the library artlib (pip install "treenail[artlib]"), got: {error}') from error
        return ART2A(rho=float(settings.rho), alpha=float(settings.alpha), beta=float(settings.beta))
