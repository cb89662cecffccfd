"""ART2, the self-organising classifier that turns force/torque vectors into contact states (thesis App. D, 4.3.2).

A presentation runs F0 and then F1 (sublayers w x v u p q) from rest until they settle, lets F2 pick the unit with the
largest T_j (4.13, 4.14), feeds that unit's weights back into F1 and compares: if ||r|| + e < rho (D.13) the unit is
inhibited and the next one tried. If none fits, a new unit is committed. The unit found then learns.

Where the thesis leaves room:

- *Settled* means that no component of u moved by more than 1e-10 in a pass, or that 200 passes were made.
- *One weight matrix.* Bottom-up z_ji and top-down z_ij obey the same law, dz/dt = g(y_J) (p_i - z), and both start
  at 0 (thesis 6.2). They can never differ, so they are kept once.
- *Learning* ends the presentation, with u as settled under the old weights: z moves by ``learning_rate`` of the way to
  the law's equilibrium u / (1 - d). That u lies close to the old prototype: for small angles and theta = 0 a class
  turns by learning_rate / (1 + (1 + a) b d) of the angle to the input, which is 1 % at the default a, b, d and full
  rate. With a and b near 1 it is 36 %, and classes are swept along by whatever comes last.
- *Committing.* Zero weights cannot win a comparison above zero, so a new unit is taken explicitly, after all that
  have T_j > 0 were reset, and gets the whole u / (1 - d) whatever the learning rate: a unit committed in part would
  have a weak top-down voice and match everything.
- *A repeated input* nearly always keeps its class at once. It need not: f cuts, and a component of u that falls below
  theta takes its weight with it, so that learning can worsen a match (thesis 4.5.2 sees such reorganisation).
- *r* compares q' of F0 with p of F1, see ``art2_kernel.match_of``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from services.classifier import art2_kernel as kernel
from services.classifier import memory
from services.classifier.encoding import encode, input_count
from services.rules.plugins import Classification, ClassifierFullError
from services.wire.definition import Art2Settings


class Art2:
    """An ART2 network whose answers depend on its settings and the vectors learnt so far, and on nothing else."""

    def __init__(self, settings: Art2Settings) -> None:
        """Make a network without classes.

        Raises:
            ValueError: theta is not below 1/sqrt(inputs), so that some directions would excite nothing at all.
        """
        inputs = input_count(settings.encoding)
        # The largest component of a unit vector is at least 1/sqrt(n): below that, f always lets something through.
        if not settings.theta < 1 / math.sqrt(inputs):
            raise ValueError(
                f"theta: expected below 1/sqrt({inputs}) = {1 / math.sqrt(inputs):.4f} with encoding "
                f'"{settings.encoding}", got {settings.theta}'
            )
        self._settings = settings
        s = settings
        # float(): an integer would make numba compile a second version of the kernel.
        self._rate = float(s.learning_rate)
        self._parameters = np.array([s.a, s.b, s.c, s.d, s.e, s.theta, s.rho], dtype=np.float64)
        self._layers = np.zeros((2, kernel.SUBLAYERS, inputs))
        self._f2 = np.zeros(settings.capacity)
        self._weights = np.zeros((settings.capacity, inputs))
        self._counts = np.zeros(settings.capacity, dtype=np.int64)
        self._states = 0

    @property
    def states(self) -> int:
        """Number of classes."""
        return self._states

    @property
    def encoding(self) -> str:
        """What the prototypes' components are: "odd" or "split"."""
        return self._settings.encoding

    @property
    def prototypes(self) -> NDArray[np.float64]:
        """Copy of the weights, shape (states, 6) or (states, 12) as the encoding has it, norm at most 1/(1-d)."""
        return self._weights[: self._states].copy()

    @property
    def counts(self) -> NDArray[np.int64]:
        """Copy of the number of presentations that each class has learnt, shape (states,), each at least 1."""
        return self._counts[: self._states].copy()

    def learn(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> Classification:
        """Classify one vector (three components each, [N] and [N m]) and learn it; commit a class if none fits.

        With all classes taken and ``when_full`` "nearest", an input that fits none is answered with the best matching
        class, which does not learn it.

        Raises:
            ValueError: see ``encoding.encode``; or, only where e > 0, the input is so small that e swallows it.
            ClassifierFullError: no class fits, none is left, and ``when_full`` is "refuse".
        """
        unit, nearest, match = self._present(force_n, torque_nm, self._rate)
        if unit == kernel.NO_UNIT:
            return self._answer_when_full(nearest, match)
        new = unit == self._states
        if new:
            self._states += 1
        self._counts[unit] += 1
        return Classification(unit, self._states, match, new)

    def classify(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> Classification:
        """Classify one vector without changing anything; ``state`` is -1 if no class fits, whatever ``when_full`` says.

        Raises:
            ValueError: as ``learn``.
        """
        unit, _, match = self._present(force_n, torque_nm, 0.0)
        return Classification(unit, self._states, match, False)

    def snapshot(self) -> dict[str, bytes | int]:
        """Everything needed to go on: ``restore`` on a network with the same settings continues bit for bit.

        Activities are not part of it, as every presentation starts from rest.
        """
        return memory.pack(self.prototypes, self.counts)

    def restore(self, snapshot: Mapping[str, object]) -> None:
        """Take over a snapshot in place of what was learnt.

        Raises:
            ValueError: unknown or missing keys, a wrong type, size or number of inputs, more classes than the capacity,
                weights that are not finite or that no presentation can have led to, a count below 1. The network
                stays as it was.
        """
        weights, counts = memory.unpack(snapshot, (self._settings.capacity, self._weights.shape[1]), "ART2")
        longest = 1 / (1 - float(self._settings.d))
        with np.errstate(over="ignore"):  # what overflows is too long
            norms = np.sqrt((weights * weights).sum(axis=1))
        # 1e-9: room for rounding in u, whose norm is at most 1 otherwise.
        if not ((norms > 0) & (norms <= longest * (1 + 1e-9))).all():
            raise ValueError(
                f"ART2 snapshot weights: expected norms above 0 and up to 1/(1-d) = {longest:g}, got {norms}"
            )
        self._states = len(counts)
        self._weights[:] = 0.0
        self._weights[: self._states] = weights
        self._counts[:] = 0
        self._counts[: self._states] = counts

    def digest(self) -> str:
        """SHA-256 in hex of the classes, see ``memory.digest``."""
        return memory.digest(self.prototypes, self.counts)

    def _present(self, force_n: Sequence[float], torque_nm: Sequence[float], rate: float) -> tuple[int, int, float]:
        """Encode and present one vector. Returns as ``kernel.present``, never SILENT."""
        s = self._settings
        stimulus = encode(force_n, torque_nm, s.torque_gain_per_m, s.encoding)
        result = kernel.present(stimulus, self._weights, self._states, self._layers, self._f2, self._parameters, rate)
        if result[0] == kernel.SILENT:
            raise ValueError(
                f"force/torque vector: expected a component above theta = {s.theta} after normalising with e = {s.e}, "
                f"got none (norm {float(np.linalg.norm(stimulus)):g}, torque times {s.torque_gain_per_m:g} 1/m)"
            )
        return result

    def _answer_when_full(self, nearest: int, match: float) -> Classification:
        """What an input gets that fits none of the classes, all of which are taken."""
        if self._settings.when_full == "refuse":
            raise ClassifierFullError(
                f"classes: expected at most {self._settings.capacity} (capacity), got an input that needs another one: "
                f"its best match is {match:.4f} with class {nearest}, vigilance {self._settings.rho}"
            )
        return Classification(nearest, self._states, match, False)
