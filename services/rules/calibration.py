"""Weight and centre of gravity of a tool, and the zero of its sensor, out of a few poses in the air. Pure.

With the tool turned by R and the sensor turned in the wrist by S, a still sensor in the air shows

    force = zero + w        w = (R S)^T weight        torque = zero + centre x w

Both are linear in what is sought, so that least squares give it; what they leave unexplained says whether it was so.
The weight is one of the hole frame: where down is need not be known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from services.rules.forces import G_M_PER_S2, spread
from services.rules.window import mean
from services.rules.workspace import Matrix, product, rotation
from services.wire.definition import Calibration, Definition
from services.wire.errors import TreenailError
from services.wire.messages import Force, Torque

MOST_UNSURE = 0.2
"""Of the weight, relative to it, and at least ``SURE_N``: poses that leave more open are too much alike."""
SURE_N = 0.5

Floats = npt.NDArray[np.float64]


class CalibrationError(TreenailError):
    """Poses or samples that no calibration follows from."""


class Turned(NamedTuple):
    """A pose: how the tool is turned in the hole frame, R = Rz Ry Rx [deg]."""

    rx_deg: float
    ry_deg: float
    rz_deg: float


class Still(NamedTuple):
    """What a sensor showed in a pose."""

    turned: Turned
    force_n: Force
    """Mean of the samples."""
    torque_nm: Torque
    sigma_n: float
    """Standard deviation of each force component of a sample."""
    sigma_nm: float
    samples: int


class Fit(NamedTuple):
    """A calibration, and how sure it is."""

    calibration: Calibration
    mass_kg: float
    unsure_kg: float
    """Standard deviation of the mass, by what the fit left unexplained."""
    unsure_mm: float
    """The same of the centre of gravity, of its least certain component; infinite without a weight."""


def poses(tilt_deg: float) -> tuple[Turned, ...]:
    """Return the six poses of the routine: straight, tilted both ways about X and Y, and about both at once."""
    ways = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (0.7, 0.7))
    return tuple(Turned(tilt_deg * x, tilt_deg * y, 0.0) for x, y in ways)


def still(turned: Turned, forces_n: Sequence[Force], torques_nm: Sequence[Torque]) -> Still:
    """Return what samples of a pose come to."""
    return Still(
        turned, mean(forces_n), mean(torques_nm), spread(forces_n), spread(torques_nm), min(len(forces_n), 10**9)
    )


def fit(seen: Sequence[Still], definition: Definition) -> Fit:
    """Return the calibration that explains what was seen in four or more poses. Raises CalibrationError."""
    if len(seen) < 4:
        raise CalibrationError(f"tare: expected four or more poses, got {len(seen)}")
    wrist = definition.wrist
    mount = rotation(wrist.sensor_rx_deg, wrist.sensor_ry_deg, wrist.sensor_rz_deg)
    turns = [_array(product(rotation(*one.turned), mount)) for one in seen]
    identity = np.eye(3)
    forces = _solve([np.hstack((identity, turn.T)) for turn in turns], [one.force_n for one in seen])
    weight = forces.solution[3:]
    felt = [turn.T @ weight for turn in turns]
    size_n, unsure_n = float(np.linalg.norm(weight)), float(forces.unsure[3:].max())
    if unsure_n > max(SURE_N, MOST_UNSURE * size_n):
        got = f"one of {size_n:.2f} N that is unsure by {unsure_n:.2f} N"
        hint = "was the tool in the air and turned as asked for, and is the sensor mounted as the definition says?"
        raise CalibrationError(f"tare: expected poses from which the weight follows, got {got}; {hint}")
    torques = _centre(felt, [one.torque_nm for one in seen], size_n, unsure_n)
    sigma_n = _pooled([(one.sigma_n, one.samples) for one in seen])
    if sigma_n == 0.0:
        raise CalibrationError("tare: expected a sensor that shows noise, got the very same samples; is it dead?")
    weight_n, centre_m = weight.tolist(), torques.solution[3:].tolist()
    measured = {
        "sigma_n": sigma_n,
        "sigma_nm": _pooled([(one.sigma_nm, one.samples) for one in seen]),
        **{f"weight_{axis}_n": value for axis, value in zip("xyz", weight_n, strict=True)},
        **{f"centre_{axis}_mm": 1e3 * value for axis, value in zip("xyz", centre_m, strict=True)},
        **{f"zero_f{axis}_n": value for axis, value in zip("xyz", forces.solution[:3].tolist(), strict=True)},
        **{f"zero_t{axis}_nm": value for axis, value in zip("xyz", torques.solution[:3].tolist(), strict=True)},
        "residual_n": forces.residual,
        "residual_nm": torques.residual,
    }
    # Six digits are more than any of them is sure to, and a person can read them.
    calibration = Calibration(**{name: float(f"{value:.6g}") for name, value in measured.items()})
    return Fit(calibration, size_n / G_M_PER_S2, unsure_n / G_M_PER_S2, 1e3 * float(torques.unsure[3:].max()))


class _Solved(NamedTuple):
    solution: Floats
    unsure: Floats
    residual: float


def _solve(rows: Sequence[Floats], values: Sequence[Force]) -> _Solved:
    """Return least squares, standard deviation of each unknown, and the root mean square of what is left."""
    matrix, right = np.vstack(rows), np.concatenate([np.array(value) for value in values])
    solution, _, rank, _ = np.linalg.lstsq(matrix, right, rcond=1e-6)
    if rank < matrix.shape[1]:
        raise CalibrationError("tare: expected poses that are turned differently, got some that are too much alike")
    left = right - matrix @ solution
    residual = math.sqrt(float(left @ left) / (len(right) - matrix.shape[1]))
    unsure = residual * np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
    return _Solved(solution, unsure, residual)


def _centre(felt: Sequence[Floats], torques: Sequence[Torque], size_n: float, unsure_n: float) -> _Solved:
    """Return zero and centre of gravity [m] by the torques; of a tool that weighs nothing the zero alone."""
    if size_n <= max(3.0 * unsure_n, 1e-6):
        mean_nm = np.mean(np.array(torques), axis=0)
        left = np.array(torques) - mean_nm
        residual = math.sqrt(float((left * left).sum()) / (left.size - 3))
        return _Solved(np.concatenate((mean_nm, np.zeros(3))), np.full(6, np.inf), residual)
    return _solve([np.hstack((np.eye(3), _crossed_with(weight))) for weight in felt], torques)


def _crossed_with(weight: Floats) -> Floats:
    """Return the matrix that gives ``centre x weight`` of a centre."""
    x, y, z = weight.tolist()
    return np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])


def _array(turn: Matrix) -> Floats:
    return np.array(turn)


def _pooled(spreads: Sequence[tuple[float, int]]) -> float:
    """Return the standard deviation of several sets of samples, each with its own mean."""
    return math.sqrt(sum((count - 1) * sigma**2 for sigma, count in spreads) / sum(count - 1 for _, count in spreads))
