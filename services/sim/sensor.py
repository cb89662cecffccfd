"""The simulated force/torque sensor: what it shows of a load, with the tool's weight, a wandering zero and noise.

What it shows is a function of definition, seed, episode, step, load and orientation, and of nothing else; behind a
low-pass (``sensor.filter_hz``) also of the loads since the episode began.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from services.rules.ft_counts import FtCounts
from services.sim.low_pass import LowPass
from services.sim.mount import Mount
from services.sim.pose import Pose, Vector, conjugate, rotate
from services.sim.world import Reading
from services.wire.definition import Definition, Drift, Sensor, Tool
from services.wire.messages import Force, Torque
from services.wire.randomness import Draws, Role, generator

G_M_PER_S2 = 9.80665
RAMP_MOTIONS = 1000
"""Motions in which the zero goes as far as ``drift.ramp_n`` says."""

Floats = npt.NDArray[np.float64]
Samples = list[tuple[Force, Torque]]


class SimulatedSensor:
    """The sensor of one run."""

    def __init__(self, definition: Definition, seed: int) -> None:
        sensor, noise = definition.sensor, definition.noise
        self._window, self._at_home = sensor.window, max(sensor.window, sensor.tare_samples)
        self.most_samples = self._at_home
        """Most samples after one motion."""
        self._force_error_n, self._torque_error_nm = noise.scale * noise.force_n, noise.scale * noise.torque_nm
        self._exact = self._force_error_n == 0.0 and self._torque_error_nm == 0.0
        self._errors = np.array([self._force_error_n] * 3 + [self._torque_error_nm] * 3)
        """Standard deviation of each component of a sample [N, N m], shape (6,)."""
        self._counts = _counts(sensor)
        self._mount = Mount(definition.wrist, seed)
        self._weight = Weight(definition.tool, definition.wrist.sensor_height_mm)
        self._zero = Zero(definition.drift, seed)
        self._draws = Draws(seed, Role.SENSOR_NOISE)
        self._low_pass = LowPass(sensor) if sensor.filter_hz > 0.0 else None

    def samples(
        self, load: Reading, flange: Pose, episode: int, step: int, count: int | None = None
    ) -> tuple[Samples, bool]:
        """Return the samples after a motion, each with an error of its own, and whether any of them is saturated.

        ``load`` is what the surroundings do to the peg. The number of samples is that of the window, or of the tare
        at the start of an episode; ``count`` are as many of an arm that has stood still for long.
        """
        at_rest = step == 0 or count is not None
        if count is None:
            count = self._at_home if step == 0 else self._window
        force_n, torque_nm = self._zero.added(*self._seen(load, flange), episode, step)
        if self._low_pass is None:
            loads = self._with_errors(force_n, torque_nm, episode, step, count)
        else:
            loads = self._filtered(self._low_pass, (*force_n, *torque_nm), episode, step, count, at_rest)
        if self._counts is None or not all(math.isfinite(value) for one in loads for value in (*one[0], *one[1])):
            return loads, False
        counted = [self._counts.quantised(*one) for one in loads]
        return [(force, torque) for force, torque, _ in counted], any(saturated for *_, saturated in counted)

    def _seen(self, load: Reading, flange: Pose) -> tuple[Force, Torque]:
        force_n, torque_nm = self._weight.added(load, flange)
        return self._mount.seen(force_n), self._mount.seen(torque_nm)

    def _with_errors(self, force_n: Force, torque_nm: Torque, episode: int, step: int, count: int) -> Samples:
        if self._exact:
            return [(force_n, torque_nm)] * count
        draw = self._draws.at(episode, step)
        if count == 1:  # without arrays, which cost more than all else here
            force_error_n, torque_error_nm = self._force_error_n, self._torque_error_nm
            fx, fy, fz = force_n
            tx, ty, tz = torque_nm
            ex, ey, ez, ea, eb, ec = draw.standard_normal(6).tolist()
            force = (fx + force_error_n * ex, fy + force_error_n * ey, fz + force_error_n * ez)
            return [(force, (tx + torque_error_nm * ea, ty + torque_error_nm * eb, tz + torque_error_nm * ec))]
        rows = (np.array((*force_n, *torque_nm)) + self._errors * draw.standard_normal((count, 6))).tolist()
        return [((fx, fy, fz), (tx, ty, tz)) for fx, fy, fz, tx, ty, tz in rows]

    def _filtered(
        self, low_pass: LowPass, load: Sequence[float], episode: int, step: int, count: int, at_rest: bool
    ) -> Samples:
        """Return samples behind the filter, which takes in those of the motion before them, too."""
        rows = low_pass.before(at_rest) + count
        errors = [(0.0,) * 6] * rows
        if not self._exact:
            errors = (self._errors * self._draws.at(episode, step).standard_normal((rows, 6))).tolist()
        read = low_pass.read(load, errors, at_rest)
        return [((fx, fy, fz), (tx, ty, tz)) for fx, fy, fz, tx, ty, tz in read]


class Weight:
    """The tool's weight, as the sensor feels it: along the tool's axes, about the sensor's point."""

    def __init__(self, tool: Tool, sensor_height_mm: float) -> None:
        self._none = tool.mass_kg == 0.0
        factor = tool.mass_kg * G_M_PER_S2 / math.hypot(tool.down_x, tool.down_y, tool.down_z)
        self._hole_n: Vector = (factor * tool.down_x, factor * tool.down_y, factor * tool.down_z)
        """In the hole frame [N]."""
        arm_mm = (tool.centre_x_mm, tool.centre_y_mm, tool.centre_z_mm + sensor_height_mm)
        self._arm_m: Vector = (arm_mm[0] * 1e-3, arm_mm[1] * 1e-3, arm_mm[2] * 1e-3)
        """From the sensor's point to the centre of gravity, in the tool frame [m]."""

    def added(self, load: Reading, flange: Pose) -> tuple[Vector, Vector]:
        """Return a load with the weight added, at the orientation of the flange."""
        if self._none:
            return load
        wx, wy, wz = rotate(conjugate(flange.orientation), self._hole_n)
        x, y, z = self._arm_m
        (fx, fy, fz), (tx, ty, tz) = load
        torque = (tx + y * wz - z * wy, ty + z * wx - x * wz, tz + x * wy - y * wx)
        return (fx + wx, fy + wy, fz + wz), torque


class Zero:
    """What the sensor shows without a load, in each episode and step."""

    def __init__(self, drift: Drift, seed: int) -> None:
        self._none = drift == Drift()
        self._seed = seed
        first = generator(seed, Role.SENSOR_ZERO, 0, 0).standard_normal((2, 6))
        self._first: Floats = _six(drift.offset_n, drift.offset_nm) * first[0]
        self._walk = _six(drift.walk_n, drift.walk_nm)
        ramp = first[1].reshape(2, 3)
        way = (ramp / np.sqrt((ramp * ramp).sum(axis=1, keepdims=True))).reshape(6)
        self._ramp = _six(drift.ramp_n, drift.ramp_nm) * way / RAMP_MOTIONS
        self._episode, self._at_start = 0, self._first

    def added(self, force_n: Force, torque_nm: Torque, episode: int, step: int) -> tuple[Force, Torque]:
        """Return a load with the zero of an episode and step added."""
        if self._none:
            return force_n, torque_nm
        zero = self._start_of(episode) + step * self._ramp
        fx, fy, fz, tx, ty, tz = (np.array((*force_n, *torque_nm)) + zero).tolist()
        return (fx, fy, fz), (tx, ty, tz)

    def _start_of(self, episode: int) -> Floats:
        """Return the zero at the start of an episode: all steps of the walk before it, always added in the same order.

        So it does not depend on which episodes were simulated before.
        """
        if not self._walk.any():
            return self._first
        if episode < self._episode:
            self._episode, self._at_start = 0, self._first
        at_start: Floats = self._at_start
        for number in range(self._episode + 1, episode + 1):
            at_start = at_start + self._walk * generator(self._seed, Role.ZERO_WALK, number, 0).standard_normal(6)
        self._episode, self._at_start = episode, at_start
        return at_start


def _six(force_n: float, torque_nm: float) -> Floats:
    return np.array([force_n] * 3 + [torque_nm] * 3, dtype=np.float64)


def _counts(sensor: Sensor) -> FtCounts | None:
    """Return the scale of a sensor that is read in counts, None for one that is read as it is."""
    if sensor.full_scale_n == 0:
        return None
    return FtCounts("1", (sensor.full_scale_n,) * 3 + (sensor.full_scale_dnm,) * 3)
