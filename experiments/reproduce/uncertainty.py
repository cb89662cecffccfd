"""Chapter 5: sensor and arm under the thesis's two measurements, simulated again and again, beside what it printed."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib.resources import files
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.reproduce.chapter import Chapter, Comparison, Comparisons, Figure, Heading, Table, Text
from experiments.reproduce.context import Context
from experiments.reproduce.figures import COLOURS, drawing, svg
from experiments.reproduce.verdicts import Verdict, among, interval
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
    facts = tomllib.loads((files("experiments") / "thesis_cell.toml").read_text())
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


def _sensor(measured: Measured, noise: Noise) -> list[Heading | Figure | Comparisons]:
    facts = measured.sensor
    count = round(facts["duration_s"] * READINGS_PER_S)
    force_errors: list[float] = []
    torque_errors: list[float] = []
    for repetition in range(REPETITIONS):
        read = readings(noise, facts["load_n"], count, repetition)
        force_errors.append(float(np.abs(np.linalg.norm(read[:, :3], axis=1) - facts["load_n"]).max()))
        torque_errors.append(float(np.linalg.norm(read[:, 3:], axis=1).max() / facts["torque_unit_nm"]))
    why = "How often the thesis read its sensor is not said, and the greatest of more readings is greater."
    filtered = "The 31 Hz filter is not modelled: the learner is given single readings, and the thesis's are one run."
    rows = [
        Comparison(
            "greatest force error in 60 s",
            f"{facts['force_error_n']:g} N",
            force_errors,
            among(facts["force_error_n"]),
            why,
            "N",
        ),
        Comparison(
            "greatest torque error in 60 s",
            f"{facts['torque_error']:g} (N m x 10)",
            torque_errors,
            among(facts["torque_error"]),
            why,
        ),
        Comparison(
            "31 Hz filter: greatest torque error",
            f"{facts['torque_error_filtered']:g} (N m x 10)",
            "not modelled",
            Verdict.DIFFERS,
            filtered,
        ),
    ]
    read = readings(noise, facts["load_n"], count, 0)
    seconds = np.arange(count) / READINGS_PER_S
    return [
        Heading("The sensor with 5 N hung under it (5.1.1, B.1)"),
        Figure("5.1, B.1-B.3", "Force, unfiltered: its length, and its components beside it.", _force(seconds, read)),
        Figure("5.2, B.7-B.9", "Torque, unfiltered, in the thesis's unit.", _torque(seconds, read, facts)),
        Comparisons(rows),
    ]


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


def _torque(seconds: Rows, read: Rows, facts: Mapping[str, float]) -> str:
    torque = read[:, 3:] / facts["torque_unit_nm"]
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
    rows: list[Comparison] = []
    shown: list[tuple[str, ...]] = []
    for direction, table in measured.motion.items():
        simulated = [
            motions(noise, measured.commanded_mm, direction, len(table), number) for number in range(REPETITIONS)
        ]
        axis = AXES.index(direction[1])
        for what, figure in (("mean along", _mean), ("spread along", _spread), ("greatest across", _across)):
            theirs, ours = figure(table, axis), [figure(one, axis) for one in simulated]
            why = "Single series of five readings; one size of error stands for all directions (decision 6)."
            rows.append(Comparison(f"{direction}: {what}", f"{theirs:.3f} mm", ours, among(theirs), why, "mm"))
        low, median, high = interval([_mean(one, axis) for one in simulated])
        readings_mm = " ".join(f"{value:.3f}" for value in table[:, axis])
        shown.append((direction, readings_mm, f"{median:.3f} ({low:.3f} to {high:.3f})"))
    head = ("direction", "thesis: five readings along it [mm]", "ours: mean of five [mm]")
    caption = f"One motion of {measured.commanded_mm:g} mm, five times in each direction."
    return [
        Heading("The arm's accuracy (5.1.2)"),
        Table("5.1-5.3", caption, head, shown),
        Comparisons(rows, "Each direction's five readings, and five of ours"),
    ]


def _mean(table: Rows, axis: int) -> float:
    return float(table[:, axis].mean())


def _spread(table: Rows, axis: int) -> float:
    return float(table[:, axis].std(ddof=1))


def _across(table: Rows, axis: int) -> float:
    return float(np.abs(np.delete(table, axis, axis=1)).max())
