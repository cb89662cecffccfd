"""How six force/torque components become the input vector of ART2's layer F0.

The thesis feeds the raw components (4.5.2). Its threshold-linear signal function passes positive activity only, so
signed components need a carrier for their sign; both usual ones are offered, see ``encode``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Encoding = Literal["odd", "split"]

AXES = 3
SMALLEST_NORM = 1e-100
LARGEST_NORM = 1e100
"""Outside these two the squares of the components would leave the range of double precision."""


def input_count(encoding: Encoding) -> int:
    """Length of the vector that ``encode`` returns: 6 for "odd", 12 for "split"."""
    return 2 * AXES if encoding == "odd" else 4 * AXES


def encode(
    force_n: Sequence[float], torque_nm: Sequence[float], torque_gain_per_m: float, encoding: Encoding
) -> NDArray[np.float64]:
    """Input vector of F0 for one force/torque sample, in newtons.

    Args:
        force_n: the three force components [N], any frame, but always the same one.
        torque_nm: the three torque components [N m] in that frame.
        torque_gain_per_m: factor [1/m] that brings torques to the scale of the forces.
        encoding: "odd" returns the signed components fx fy fz tx ty tz, to be used with an odd-symmetric signal
            function. "split" returns the positive parts of the six, then the negative parts, none below zero.

    Returns:
        Array of shape (6,) or (12,), finite, with a norm between ``SMALLEST_NORM`` and ``LARGEST_NORM``.

    Raises:
        ValueError: a wrong length, a component that is not finite, or a vector with no direction (zero).
    """
    if len(force_n) != AXES or len(torque_nm) != AXES:
        _check_three("force_n", force_n)
        _check_three("torque_nm", torque_nm)
    (fx, fy, fz), (tx, ty, tz), gain = force_n, torque_nm, torque_gain_per_m
    components = [float(fx), float(fy), float(fz), gain * float(tx), gain * float(ty), gain * float(tz)]
    norm = math.hypot(*components)
    if not SMALLEST_NORM <= norm <= LARGEST_NORM:
        _check_three("force_n", force_n)
        _check_three("torque_nm", torque_nm)
        raise ValueError(
            f"norm of the force/torque vector (torque times {torque_gain_per_m:g} 1/m): expected "
            f"{SMALLEST_NORM:g} to {LARGEST_NORM:g}, because ART2 classifies directions; got {norm:g}"
        )
    if encoding == "split":
        # The comparisons also turn -0.0 into 0.0, so that the two zeros give the same bits.
        components = [c if c > 0.0 else 0.0 for c in components] + [-c if c < 0.0 else 0.0 for c in components]
    return np.array(components, dtype=np.float64)


def _check_three(name: str, values: Sequence[float]) -> None:
    """Raise ValueError for what is no axis triple of finite values."""
    if len(values) != AXES:
        raise ValueError(f"{name}: expected {AXES} components, got {len(values)}")
    for axis, value in zip("xyz", values, strict=True):
        if not math.isfinite(value):
            raise ValueError(f"{name}: expected finite components, got {float(value)} for {axis}")
