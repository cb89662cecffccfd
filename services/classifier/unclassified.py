"""No classification: whatever is felt is of the one class 0, for an agent that goes by force and torque alone."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from services.rules.plugins import Classification

_INPUTS = 6


class OneClass:
    """The one class, there from the beginning; see ``services.rules.plugins.Classifier`` for what it promises."""

    encoding = "none"

    def __init__(self) -> None:
        self._felt = 0

    @property
    def states(self) -> int:
        """Number of classes."""
        return 1

    @property
    def prototypes(self) -> NDArray[np.float64]:
        """Zeros, shape (1, 6): it has no direction."""
        return np.zeros((1, _INPUTS))

    @property
    def counts(self) -> NDArray[np.int64]:
        """Presentations so far, shape (1,)."""
        return np.array([self._felt], np.int64)

    def learn(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> Classification:
        """Count a vector (three components each, [N] and [N m])."""
        self._felt += 1
        return self.classify(force_n, torque_nm)

    def classify(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> Classification:
        """Answer the one class."""
        return Classification(state=0, states=1, match=1.0, new=False)

    def snapshot(self) -> dict[str, bytes | int]:
        """Return the number of presentations."""
        return {"states": 1, "felt": self._felt}

    def restore(self, snapshot: Mapping[str, bytes | int]) -> None:
        """Take over a snapshot. ValueError, with nothing changed, when it does not fit."""
        felt = snapshot.get("felt")
        if set(snapshot) != {"states", "felt"} or snapshot["states"] != 1 or not isinstance(felt, int) or felt < 0:
            raise ValueError(f"snapshot: expected states = 1 and felt of 0 or more, got {sorted(snapshot)}")
        self._felt = felt

    def digest(self) -> str:
        """Return the SHA-256, in hex, of the number of presentations."""
        return hashlib.sha256(f"one class, {self._felt}".encode()).hexdigest()
