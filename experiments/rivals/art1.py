"""ART1 on coarse inputs, as a classifier (thesis 7.4.5; Carpenter and Grossberg 1987).

The thesis proposes the faster ART1 in place of ART2, since a sensor reads whole numbers. ART1 takes bits. So each of
the six components, as a part of the whole vector's length, is held against a few thresholds, and each threshold gives
two bits: above it, or not. A class keeps the bits that all its members share.
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


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the plug-in ``art1``."""

    rho: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.8
    """Vigilance: part of an input's bits that a class must share."""
    choice: Annotated[float, msgspec.Meta(gt=1, le=100)] = 2.0
    """L of the paper, above 1: near 1 the class with the most bits in common is preferred less."""
    levels: Annotated[int, msgspec.Meta(ge=1, le=8)] = 2
    """Thresholds on either side of zero: 1 tells three sizes of a component apart, 2 five."""
    torque_gain_per_m: Annotated[float, msgspec.Meta(ge=0, le=1000)] = 10.0
    """Factor from N m to input units, forces being in N."""
    capacity: Annotated[int, msgspec.Meta(ge=1, le=10000)] = 200
    """Most classes there can be; then an input that fits none is refused."""


class Art1:
    """An ART1 network. See ``services.rules.plugins.Classifier`` for what its methods promise."""

    encoding = "thresholds"

    def __init__(self, settings: Mapping[str, Setting]) -> None:
        """Make a network without classes. Raises ValueError for wrong settings."""
        self._settings = settings_as(Settings, settings)
        count = self._settings.levels
        above = [(level + 1) / (count + 1) for level in range(count)]
        self._thresholds = np.array([-value for value in reversed(above)] + above)
        self._bits = 2 * len(self._thresholds) * _COMPONENTS
        self._weights = np.zeros((0, self._bits))
        self._counts = np.zeros(0, np.int64)

    @property
    def states(self) -> int:
        """Number of classes."""
        return len(self._counts)

    @property
    def prototypes(self) -> NDArray[np.float64]:
        """Copy of the bits that each class has kept, shape (states, bits), each 0 or 1."""
        return self._weights.copy()

    @property
    def counts(self) -> NDArray[np.int64]:
        """Copy of the presentations that each class has learnt, shape (states,)."""
        return self._counts.copy()

    def learn(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> Classification:
        """Classify one vector [N], [N m] and learn it; make a class if none fits."""
        bits = self.coarse(force_n, torque_nm)
        unit, match = self._search(bits)
        new = unit < 0
        if new:
            if self.states == self._settings.capacity:
                raise ClassifierFullError(
                    f"classes: expected at most {self._settings.capacity} (capacity), got one more"
                )
            unit, match = self.states, 1.0
            self._weights = np.vstack([self._weights, bits])
            self._counts = np.append(self._counts, 0)
        self._weights[unit] *= bits
        self._counts[unit] += 1
        return Classification(unit, self.states, match, new)

    def classify(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> Classification:
        """Classify one vector [N], [N m] and change nothing."""
        unit, match = self._search(self.coarse(force_n, torque_nm))
        return Classification(unit, self.states, match, False)

    def snapshot(self) -> dict[str, bytes | int]:
        """Return all that was learnt."""
        return memory.pack(self._weights, self._counts)

    def restore(self, snapshot: Mapping[str, bytes | int]) -> None:
        """Take over a snapshot. Raises ValueError."""
        weights, counts = memory.unpack(snapshot, (self._settings.capacity, self._bits), "ART1")
        if not ((weights == 0.0) | (weights == 1.0)).all():
            raise ValueError("ART1 snapshot weights: expected bits, each 0 or 1, got other numbers")
        self._weights, self._counts = weights, counts

    def digest(self) -> str:
        """Return the SHA-256, in hex, of the classes."""
        return memory.digest(self._weights, self._counts)

    def coarse(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> NDArray[np.float64]:
        """Return the bits of a vector, shape (bits,): for each component above each threshold, then not above it.

        Raises ValueError.
        """
        components = encode(force_n, torque_nm, self._settings.torque_gain_per_m, "odd")
        unit = components / np.sqrt((components * components).sum())
        above = (unit[:, None] > self._thresholds).astype(np.float64).ravel()
        return np.concatenate([above, 1.0 - above])

    def _search(self, bits: NDArray[np.float64]) -> tuple[int, float]:
        """Return the class that fits, -1 if none does, and its match, the best one's if none fits."""
        if not self.states:
            return -1, 0.0
        common = (bits * self._weights).sum(axis=1)
        match = common / bits.sum()
        choice = common / (self._settings.choice - 1.0 + self._weights.sum(axis=1))
        fitting = np.where(match >= self._settings.rho, choice, -1.0)
        unit = int(fitting.argmax())
        return (unit, float(match[unit])) if fitting[unit] >= 0.0 else (-1, float(match.max()))
