"""Force/torque vectors to classify: recorded from insertions in the simulator, or read from a data set of a real robot.

The insertions are supervised: the moves come from a supervisor who knows where the peg is. He steers for a point near
the hole's axis, presses on, and now and then does something else, so that many contact states occur. What he knows
goes into no vector; beside each vector stands what truly touched.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from msgspec.structs import replace

from experiments.lab.contact_states import Sample
from experiments.lab.guided import make, told
from services.sim.cell import SimulatedCell
from services.sim.pose import Pose, rotation_vector
from services.task.insertion import Insertion
from services.wire.actions import INSERT
from services.wire.definition import Definition, Start
from services.wire.definition_file import load, run_id
from services.wire.errors import TreenailError
from services.wire.messages import EpisodeSummary, Home, Move, Outcome
from services.wire.text import decode, number

THESIS_VECTORS = 20224
"""As many as the thesis recorded (4.5.2)."""
EXPERIMENT = "chamfered-q-softmax"
"""The shipped experiment whose cell is recorded: round peg, chamfered hole, noise as in thesis 5.1."""
START = Start(x_mm=0.0, y_mm=0.0, rx_deg=0.0, ry_deg=0.0, xy_spread_mm=2.4, tilt_spread_deg=2.0)
"""Where its insertions begin instead."""
AIM_MM, AIM_DEG = 0.8, 1.0
"""The supervisor steers for a point and a tilt this far, or less, from the axis: with 0.5 mm of play he touches."""
STRAY = 0.15
"""Part of his moves that are any at all."""
PRESS = 0.5
"""Part of the others that press on though the peg is off its course."""
WARY_N = 5.0
"""From this force on he only corrects; 10 N are a collision."""
_SUPERVISOR = 2006
"""Keeps his dice apart from all others with the same seed."""

FAILURES = ("lp1", "lp2", "lp3")
"""Learning problems of the data set "Robot Execution Failures" that are read."""
FAILURES_FOLDER = "robot_execution_failures"
SAMPLES = 15
"""Force/torque samples of an execution."""
COLUMNS = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
"""Columns of the files: three forces and three torques, whole numbers without a unit."""
Vector = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Supervised:
    """One insertion: what was felt at each decision, in order, and how it ended."""

    samples: list[Sample]
    outcome: Outcome | Literal["recording ended"]


def cell() -> Definition:
    """Return the cell that is recorded."""
    shipped = load(EXPERIMENT)
    return replace(shipped, name="supervised", start=START, limits=replace(shipped.limits, no_progress_moves=100))


class Supervisor:
    """Drives one insertion; same seed and insertion, same moves in the same poses."""

    def __init__(self, definition: Definition, seed: int, insertion: int) -> None:
        self._dice = np.random.default_rng([_SUPERVISOR, seed, insertion])
        aim = self._dice.uniform(-1.0, 1.0, size=4)
        self._aim = (*(AIM_MM * aim[:2]).tolist(), *(AIM_DEG * aim[2:]).tolist())
        moves = definition.moves
        self._steps = (moves.lateral_mm, moves.lateral_mm, moves.rotation_deg, moves.rotation_deg)
        self._actions = moves.actions

    def action(self, flange: Pose, force_n: float) -> int:
        """Return his next move with the commanded pose and the force felt."""
        stray, press, pick = self._dice.random(3).tolist()
        if stray < STRAY:
            return int(pick * self._actions)
        wanted = self.corrections(flange)
        if not wanted or (press < PRESS and force_n < WARY_N):
            return INSERT
        return wanted[int(pick * len(wanted))]

    def corrections(self, flange: Pose) -> list[int]:
        """Return the moves that would bring the peg closer to its course, by more than half a step off it."""
        turn = rotation_vector(flange.orientation)
        now = (flange.x_mm, flange.y_mm, math.degrees(turn[0]), math.degrees(turn[1]))
        candidates = []
        for axis, (value, aim, step) in enumerate(zip(now, self._aim, self._steps, strict=True)):
            if abs(value - aim) > step / 2:
                forwards = 2 * axis if axis < 2 else 2 * axis + 1  # +Z stands between shifts and turns
                candidates.append(forwards if value < aim else forwards + 1)
        return [action for action in candidates if action < self._actions]


def record(definition: Definition, seed: int, vectors: int) -> list[Supervised]:
    """Record insertions until there are so many vectors, the last one cut short. Deterministic."""
    run = run_id(definition, seed)
    task, simulated = Insertion(definition, run, seed), SimulatedCell(definition, run, seed)
    done: list[Supervised] = []
    left = vectors
    while left > 0:
        done.append(_insertion(task, simulated, Supervisor(definition, seed, len(done)), len(done), left))
        left -= len(done[-1].samples)
    return done


def _insertion(task: Insertion, cell: SimulatedCell, supervisor: Supervisor, number: int, most: int) -> Supervised:
    """Make one insertion, or the beginning of it that has ``most`` vectors."""
    samples: list[Sample] = []
    motion: Home | Move = task.home(number, 0)
    while True:
        then = make(task, cell, motion).then
        if isinstance(then, EpisodeSummary):
            return Supervised(samples, then.outcome)
        if len(samples) == most:
            return Supervised(samples, "recording ended")
        samples.append(Sample(then.force_n, then.torque_nm, cell.world.contact_state()))
        action = supervisor.action(cell.world.flange, math.hypot(*then.force_n))
        motion = task.act(told(then, action))


class DataError(TreenailError):
    """A data set is not what it should be; the message names file and line."""


@dataclass(frozen=True)
class Execution:
    """What a real robot's wrist felt in the 315 ms after something happened, and what that was."""

    label: str
    """Such as ``normal`` or ``collision``."""
    samples: list[Vector]
    """As ``COLUMNS``, in order of time."""


def read_failures(folder: Path) -> dict[str, list[Execution]]:
    """Read ``FAILURES`` from a folder, or from ``FAILURES_FOLDER`` in it, by name; DataError when one is not right."""
    below = folder / FAILURES_FOLDER
    place = below if below.is_dir() else folder
    return {name: read_executions(place / f"{name}.data") for name in FAILURES}


def read_executions(path: Path) -> list[Execution]:
    """Read a file of executions: a label on a line of its own, then its samples, and empty lines wherever they like.

    DataError for a file that cannot be read or is empty, and for the first line that is wrong.
    """
    try:
        lines = decode(path.read_bytes()).splitlines()
    except FileNotFoundError:
        raise DataError(f"{path}: expected a data file, got none") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise DataError(f"{path}: cannot be read: {reason}") from error
    done: list[Execution] = []
    begun = 0  # line of the last label
    for line, words in enumerate((text.split() for text in lines), start=1):
        if len(words) == 1 and words[0][0].isalpha() and words[0].lower() not in ("nan", "inf", "infinity"):
            _check_length(path, begun, done)
            done.append(Execution(words[0], []))
            begun = line
        elif words and not done:
            raise DataError(f"{path}:{line}: expected the label of an execution first, got {' '.join(words)[:40]!r}")
        elif words:
            done[-1].samples.append(_vector(path, line, words))
    if not done:
        raise DataError(f"{path}: expected executions, got an empty file")
    _check_length(path, begun, done)
    return done


def _check_length(path: Path, line: int, done: list[Execution]) -> None:
    """See that the last execution, whose label is in ``line``, is whole."""
    if done and len(done[-1].samples) != SAMPLES:
        got = len(done[-1].samples)
        raise DataError(f"{path}:{line}: expected {SAMPLES} samples of execution {done[-1].label!r}, got {got}")


def _vector(path: Path, line: int, words: list[str]) -> Vector:
    if len(words) != len(COLUMNS):
        raise DataError(f"{path}:{line}: expected {len(COLUMNS)} numbers ({' '.join(COLUMNS)}), got {len(words)}")
    values = []
    for name, word in zip(COLUMNS, words, strict=True):
        try:
            values.append(number(word))
        except ValueError as error:
            raise DataError(f"{path}:{line}: {name}: {error}") from None
    fx, fy, fz, tx, ty, tz = values
    return (fx, fy, fz, tx, ty, tz)
