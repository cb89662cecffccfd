"""Chapter 5: sensor and arm under the thesis's two measurements, simulated again and again, beside what it printed."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.reproduce.chapter import Chapter, Comparison, Comparisons, Figure, Heading, Table, Text
from experiments.reproduce.context import Context
from experiments.reproduce.figures import COLOURS, drawing, svg
from experiments.reproduce.verdicts import among, at_most, interval
from services.sim.arm import Arm
from services.wire.actions import Increment
from services.wire.definition import Noise
from services.wire.definition_file import load
from services.wire.randomness import Role, generator

EXPERIMENT = "chamfered-q-softmax"
READINGS_PER_S = 100
"""How often the thesis read its sensor is not said; the noise was fitted with this (decision 6)."""
REPETITIONS = 200
"""How often each of the thesis's measurements is simulated."""
FILTERED = 20
"""How often the filtered one is, at the sensor's own rate."""
SENSOR_HZ, FILTER_HZ = 8000, 31.25
"""JR3's rate of conversion and the edge of its filter 3."""
AXES = "XYZ"

Rows = NDArray[np.float64]


class Measured(NamedTuple):
    """What the thesis measured."""

    sensor: Mapping[str, float]
    commanded_mm: float
    motion: Mapping[str, Rows]
    """By direction, such as ``-X``: X, Y, Z of each repetition [mm]."""


def chapter(context: Context) -> Chapter:
    """Simulate both measurements with the noise of the shipped definitions."""
    measured, noise = thesis(), load(EXPERIMENT).noise
    introduction = Text(
        f"The simulated cell has the errors that the thesis measured of its own: Gaussian, {noise.force_n:g} N and "
        f"{noise.torque_nm:g} N m on each component that is read, {noise.along_mm:g} mm along a motion and "
        f"{noise.across_mm:g} mm across it. One figure stands for all axes. Here both measurements are simulated "
        f"{REPETITIONS} times; a number of the thesis matches when it lies in the 90 % interval of ours."
    )
    return Chapter([introduction, *_sensor(measured, noise), *_arm(measured, noise)])


def thesis() -> Measured:
    """Return the thesis's figures."""
    facts = tomllib.loads((files("experiments.reproduce") / "thesis_cell.toml").read_text())
    motion = dict(facts["motion"])
    commanded = float(motion.pop("commanded_mm"))
    return Measured(facts["sensor"], commanded, {name: np.array(rows) for name, rows in motion.items()})


def readings(noise: Noise, load_n: float, count: int, repetition: int) -> Rows:
    """Return what the sensor reads of a hanging load: fx fy fz [N], tx ty tz [N m], shape (count, 6)."""
    draw = generator(0, Role.SENSOR_NOISE, repetition, 0).standard_normal((count, 6))
    sizes = noise.scale * np.array([noise.force_n] * 3 + [noise.torque_nm] * 3)
    return np.array([0.0, 0.0, load_n, 0.0, 0.0, 0.0]) + draw * sizes


def motions(noise: Noise, commanded_mm: float, direction: str, count: int, repetition: int) -> Rows:
    """Return where ``count`` motions in a direction such as ``-X`` end, each from zero: X, Y, Z [mm], (count, 3)."""
    size = commanded_mm if direction[0] == "+" else -commanded_mm
    increment = Increment(**{f"d{direction[1].lower()}_mm": size})
    arm = Arm(noise, seed=repetition)
    number = 2 * AXES.index(direction[1]) + (direction[0] == "+")
    return np.array([arm.executed(increment, number, step)[:3] for step in range(count)])


def filtered(noise: Noise, load_n: float, offset_nm: float, seconds: float, repetition: int) -> Rows:
    """Return what the sensor's 31 Hz filter gives of a hanging load, READINGS_PER_S a second, as ``readings`` does.

    ``offset_nm`` is what the filter adds to the torque's mean: on one axis, since the thesis says only its length. The
    filter is taken for one pole at 1/256 of the 8 kHz at which the sensor converts, and the noise for white there.
    """
    raw = readings(noise, load_n, round(seconds * SENSOR_HZ), repetition)
    passed = 2.0 * np.pi * FILTER_HZ / SENSOR_HZ
    kept, smooth = 1.0 - passed, np.empty((round(seconds * READINGS_PER_S), raw.shape[1]))
    every = SENSOR_HZ // READINGS_PER_S
    weights = passed * kept ** np.arange(every)[::-1]
    value = np.array([0.0, 0.0, load_n, 0.0, 0.0, 0.0])
    for number, block in enumerate(raw.reshape(len(smooth), every, -1)):
        value = kept**every * value + weights @ block
        smooth[number] = value
    smooth[:, 3] += offset_nm
    return smooth


def _sensor(measured: Measured, noise: Noise) -> list[Heading | Figure | Comparisons]:
    facts = measured.sensor
    unit_nm, load_n = facts["torque_unit_nm"], facts["load_n"]
    count = round(facts["duration_s"] * READINGS_PER_S)
    raw = [readings(noise, load_n, count, repetition) for repetition in range(REPETITIONS)]
    offset_nm = facts["torque_means_differ"] * unit_nm
    smooth = [filtered(noise, load_n, offset_nm, facts["duration_s"], number) for number in range(FILTERED)]
    seconds = np.arange(count) / READINGS_PER_S
    return [
        Heading("The sensor with 5 N hung under it (5.1.1, B.1)"),
        Figure("5.1, B.1-B.3", "Force, unfiltered: its length, and its components.", _force(seconds, raw[0])),
        Figure("5.1, B.4-B.6", "Force with the 31 Hz filter.", _force(seconds, smooth[0])),
        Figure("5.2, B.7-B.9", "Torque, unfiltered, in the thesis's unit.", _torque(seconds, raw[0], unit_nm)),
        Figure("5.2, B.10-B.12", "Torque with the 31 Hz filter.", _torque(seconds, smooth[0], unit_nm)),
        Comparisons(_sensor_rows(facts, raw, smooth)),
    ]


def _sensor_rows(facts: Mapping[str, float], raw: Sequence[Rows], smooth: Sequence[Rows]) -> list[Comparison]:
    unit_nm, load_n = facts["torque_unit_nm"], facts["load_n"]
    ratio = [_force_error(rows, load_n) / _force_error(other, load_n) for rows, other in zip(smooth, raw, strict=False)]
    why = "How often the thesis read its sensor is not said, and the greatest of more readings is greater."
    drift = (
        "White noise behind the filter, and the shift of the mean by 0.1 that the thesis reports, make no more than "
        "this; its filtered torque must have wandered slowly too, of which it says nothing and we model nothing."
    )
    return [
        Comparison(
            "greatest force error in 60 s",
            f"{facts['force_error_n']:g} N",
            [_force_error(rows, load_n) for rows in raw],
            among(facts["force_error_n"]),
            why,
            "N",
        ),
        Comparison(
            "greatest torque error in 60 s",
            f"{facts['torque_error']:g} (N m x 10)",
            [_torque_error(rows, unit_nm) for rows in raw],
            among(facts["torque_error"]),
            why,
        ),
        Comparison(
            "31 Hz filter: force error as a part of the unfiltered one",
            "significantly reduced",
            ratio,
            at_most(0.5),
            "The filter does not take out enough.",
        ),
        Comparison(
            "31 Hz filter: greatest torque error",
            f"{facts['torque_error_filtered']:g} (N m x 10)",
            [_torque_error(rows, unit_nm) for rows in smooth],
            among(facts["torque_error_filtered"]),
            drift,
        ),
    ]


def _force_error(read: Rows, load_n: float) -> float:
    return float(np.abs(np.linalg.norm(read[:, :3], axis=1) - load_n).max())


def _torque_error(read: Rows, unit_nm: float) -> float:
    return float(np.linalg.norm(read[:, 3:], axis=1).max() / unit_nm)


def _force(seconds: Rows, read: Rows) -> str:
    with drawing(2, 1, height_inch=4.4) as (figure, ((length,), (components,))):
        length.plot(seconds, np.linalg.norm(read[:, :3], axis=1), linewidth=0.4)
        length.set_ylabel("|F| [N]")
        for axis, colour in zip(range(3), COLOURS, strict=False):
            components.plot(seconds, read[:, axis], color=colour, linewidth=0.4, label=f"F{AXES[axis].lower()}")
        components.set_ylabel("force [N]")
        components.set_xlabel("time [s]")
        components.legend(loc="center right")
        return svg(figure)


def _torque(seconds: Rows, read: Rows, unit_nm: float) -> str:
    torque = read[:, 3:] / unit_nm
    with drawing(2, 1, height_inch=4.4) as (figure, ((length,), (components,))):
        length.plot(seconds, np.linalg.norm(torque, axis=1), linewidth=0.4)
        length.set_ylabel("|M| [N m x 10]")
        for axis, colour in zip(range(3), COLOURS, strict=False):
            components.plot(seconds, torque[:, axis], color=colour, linewidth=0.4, label=f"M{AXES[axis].lower()}")
        components.set_ylabel("torque [N m x 10]")
        components.set_xlabel("time [s]")
        components.legend(loc="upper right", ncols=3)
        return svg(figure)


def _arm(measured: Measured, noise: Noise) -> list[Heading | Table | Comparisons]:
    single: list[Comparison] = []
    shown: list[tuple[str, ...]] = []
    size = measured.commanded_mm
    simulated = {
        direction: [
            motions(noise, measured.commanded_mm, direction, len(table), number) for number in range(REPETITIONS)
        ]
        for direction, table in measured.motion.items()
    }
    for direction, table in measured.motion.items():
        axis = AXES.index(direction[1])
        for what, figure in (("mean along", _mean), ("spread along", _spread), ("greatest across", _across)):
            theirs, ours = figure(table, axis), [figure(rows, axis) for rows in simulated[direction]]
            why = "A single series of five readings; one size of error stands for all directions (decision 6)."
            single.append(Comparison(f"{direction}: {what}", f"{theirs:.3f} mm", ours, among(theirs), why, "mm"))
        low, median, high = interval([_mean(rows, axis) for rows in simulated[direction]])
        readings_mm = " ".join(f"{value:.3f}" for value in table[:, axis])
        shown.append((direction, readings_mm, f"{median:.3f} ({low:.3f} to {high:.3f})"))
    head = ("direction", "thesis: five readings along it [mm]", "ours: mean of five [mm]")
    caption = f"One motion of {size:g} mm, five times in each direction."
    return [
        Heading("The arm's accuracy (5.1.2)"),
        Table("5.1-5.3", caption, head, shown),
        Comparisons(_pooled(measured, simulated), "All thirty motions together, which the noise was fitted to"),
        Comparisons(single, "Each direction's five readings, and five of ours"),
    ]


def _pooled(measured: Measured, simulated: Mapping[str, Sequence[Rows]]) -> list[Comparison]:
    """Return the comparisons of all directions together."""

    def errors(tables: Mapping[str, Rows]) -> tuple[float, float]:
        """Root mean square along the motion and across it [mm]."""
        along, across = [], []
        for direction, table in tables.items():
            axis = AXES.index(direction[1])
            size = measured.commanded_mm if direction[0] == "+" else -measured.commanded_mm
            along.append(table[:, axis] - size)
            across.append(np.delete(table, axis, axis=1).ravel())
        return _rms(np.concatenate(along)), _rms(np.concatenate(across))

    theirs = errors(measured.motion)
    ours = [errors({direction: series[n] for direction, series in simulated.items()}) for n in range(REPETITIONS)]
    why = "Fitted to this figure, so that it should not."
    return [
        Comparison(
            f"error {what} the motion, r.m.s.",
            f"{theirs[n]:.4f} mm",
            [pair[n] for pair in ours],
            among(theirs[n]),
            why,
            "mm",
        )
        for n, what in enumerate(("along", "across"))
    ]


def _rms(values: Rows) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _mean(table: Rows, axis: int) -> float:
    return float(table[:, axis].mean())


def _spread(table: Rows, axis: int) -> float:
    return float(table[:, axis].std(ddof=1))


def _across(table: Rows, axis: int) -> float:
    return float(np.abs(np.delete(table, axis, axis=1)).max())
