"""Kohonen's self-organising map, as a classifier, alone and beside the peg's relative position (Cervera, thesis 2.4).

Cervera and del Pobil let a map of 24 units order the three torques, and made a state of its winner and of where the peg
is relative to where it began: one of nine cells of the plane, for pegs with corners also one of three turns, which is
216 and 648 states. Here, too, only the torques reach the map. It orders itself as it goes; theirs had been
shown 70 000 vectors of earlier trials.

Neighbours are all units within a radius on the grid (Kohonen's bubble), so that no exponential is needed, and the same
vectors give the same map on every machine.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from services.rules.plugins import Classification, settings_as
from services.wire.actions import ACTION_NAMES
from services.wire.definition import Setting

_INPUTS = 3
_ITEM_BYTES = 8
_KEYS = {"states", "weights", "keys", "counts"}


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the plug-ins ``som`` and ``som-position``."""

    rows: Annotated[int, msgspec.Meta(ge=1, le=100)] = 4
    columns: Annotated[int, msgspec.Meta(ge=1, le=100)] = 6
    torque_gain_per_m: Annotated[float, msgspec.Meta(gt=0, le=1000)] = 10.0
    """Factor from N m to input units: what comes to 1 is a middling torque, far more is no more than a large one."""
    rate: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.3
    """Part of the way to an input that units go at first."""
    least_rate: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.01
    """The same once the map is in order."""
    ordering: Annotated[int, msgspec.Meta(ge=1, le=10_000_000)] = 2000
    """Presentations until rate and radius have fallen to what they stay at."""
    cell_steps: Annotated[int, msgspec.Meta(ge=0, le=1000)] = 3
    """How many steps to either side of the start are still the middle of the plane, or no turn."""


class Place(NamedTuple):
    """Steps commanded since the episode began, by what is counted of them."""

    x: int = 0
    y: int = 0
    turn: int = 0


class Map:
    """A grid of units, shape (rows, columns), each with weights; it begins spread over the first two inputs."""

    def __init__(self, settings: Settings) -> None:
        rows, columns = np.divmod(np.arange(settings.rows * settings.columns), settings.columns)
        self._settings, self._rows, self._columns = settings, rows, columns
        self.weights: NDArray[np.float64] = np.zeros((len(rows), _INPUTS))
        """Shape (units, 3)."""
        self.weights[:, 0] = _spread(rows, settings.rows)
        self.weights[:, 1] = _spread(columns, settings.columns)

    def winner(self, vector: NDArray[np.float64]) -> tuple[int, float]:
        """Return the unit that is nearest to a vector, the first of several, and how near, 1 for no distance at all."""
        away = self.weights - vector
        square = (away * away).sum(axis=1)
        unit = int(square.argmin())
        return unit, 1.0 / (1.0 + float(np.sqrt(square[unit])))

    def order(self, unit: int, vector: NDArray[np.float64], presentations: int) -> None:
        """Let a winner and its neighbours learn a vector, after so many presentations."""
        settings = self._settings
        ahead = max(0.0, 1.0 - presentations / settings.ordering)
        rate = settings.least_rate + (settings.rate - settings.least_rate) * ahead
        near = self.neighbours(unit, round(ahead * max(settings.rows, settings.columns) / 2.0))
        self.weights[near] += rate * (vector - self.weights[near])

    def neighbours(self, unit: int, radius: int) -> NDArray[np.bool_]:
        """Return which units are within a radius of one, itself among them, shape (units,)."""
        rows, columns = np.abs(self._rows - self._rows[unit]), np.abs(self._columns - self._columns[unit])
        near: NDArray[np.bool_] = np.maximum(rows, columns) <= radius
        return near


class Som:
    """A map as a classifier: states are its winners, numbered in order of birth. See ``plugins.Classifier``."""

    encoding = "torques"
    _cells = 1

    def __init__(self, settings: Mapping[str, Setting]) -> None:
        """Make a map that has seen nothing. Raises ValueError for wrong settings."""
        self._settings = settings_as(Settings, settings)
        self._map = Map(self._settings)
        self._numbers: dict[int, int] = {}
        """Of the states that were met, by winner and cell."""
        self._counts: list[int] = []

    @property
    def states(self) -> int:
        """Number of states that were met."""
        return len(self._counts)

    @property
    def prototypes(self) -> NDArray[np.float64]:
        """Copy of the weights of each state's winner, shape (states, 3)."""
        return self._map.weights[[key // self._cells for key in self._numbers]]

    @property
    def counts(self) -> NDArray[np.int64]:
        """Presentations that each state has had, shape (states,)."""
        return np.array(self._counts, np.int64)

    def learn(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> Classification:
        """Classify one vector [N], [N m] and let the map learn it."""
        vector = self._vector(force_n, torque_nm)
        unit, match = self._map.winner(vector)
        self._map.order(unit, vector, sum(self._counts))
        key = self._key(unit)
        new = key not in self._numbers
        if new:
            self._numbers[key] = len(self._counts)
            self._counts.append(0)
        state = self._numbers[key]
        self._counts[state] += 1
        return Classification(state, self.states, match, new)

    def classify(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> Classification:
        """Classify one vector [N], [N m] and change nothing."""
        unit, match = self._map.winner(self._vector(force_n, torque_nm))
        return Classification(self._numbers.get(self._key(unit), -1), self.states, match, False)

    def snapshot(self) -> dict[str, bytes | int]:
        """Return all that was learnt."""
        return {
            "states": self.states,
            "weights": self._map.weights.astype("<f8").tobytes(),
            "keys": np.array(list(self._numbers), "<i8").tobytes(),
            "counts": self.counts.astype("<i8").tobytes(),
        }

    def restore(self, snapshot: Mapping[str, bytes | int]) -> None:
        """Take over a snapshot. Raises ValueError."""
        if set(snapshot) != _KEYS:
            raise ValueError(f"SOM snapshot: expected keys {sorted(_KEYS)}, got {sorted(map(str, snapshot))}")
        states, units = snapshot["states"], len(self._map.weights)
        if type(states) is not int or not 0 <= states <= units * self._cells:
            raise ValueError(f"SOM snapshot states: expected 0 to {units * self._cells}, got {states!r}")
        weights = np.frombuffer(_block(snapshot, "weights", units * _INPUTS), "<f8").reshape(units, _INPUTS)
        keys: list[int] = np.frombuffer(_block(snapshot, "keys", states), "<i8").tolist()
        counts: list[int] = np.frombuffer(_block(snapshot, "counts", states), "<i8").tolist()
        if not (np.abs(weights) <= 1.0).all():
            raise ValueError("SOM snapshot weights: expected numbers from -1 to 1, got others")
        if len(set(keys)) != states or not all(0 <= key < units * self._cells for key in keys):
            raise ValueError(f"SOM snapshot keys: expected each once, below {units * self._cells}, got {keys}")
        if not all(count >= 1 for count in counts):
            raise ValueError(f"SOM snapshot counts: expected at least 1 for each state, got {counts}")
        self._map.weights = weights.astype(np.float64)
        self._numbers = {key: number for number, key in enumerate(keys)}
        self._counts = counts

    def digest(self) -> str:
        """Return the SHA-256, in hex, of map and states."""
        parts = self.snapshot()
        whole = b"".join(value for name in ("weights", "keys", "counts") if isinstance(value := parts[name], bytes))
        return hashlib.sha256(whole).hexdigest()

    def _key(self, unit: int) -> int:
        """Return what is a state of its own."""
        return unit

    def _vector(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> NDArray[np.float64]:
        """Return what the map sees, shape (3,), each from -1 to 1. Raises ValueError."""
        whole = np.array([*force_n, *torque_nm], np.float64)
        if whole.shape != (2 * _INPUTS,) or not np.isfinite(whole).all():
            raise ValueError(f"force and torque: expected three finite numbers each, got {force_n} and {torque_nm}")
        torque = self._settings.torque_gain_per_m * whole[_INPUTS:]
        return torque / (1.0 + np.abs(torque))


class SomWithPosition(Som):
    """The map beside where the peg was moved to since the episode began: it is told which moves were decided on.

    Moves are those of the thesis by their number; what the arm made of them, and where the episode began, it never
    hears. See ``plugins.EpisodicClassifier``.
    """

    _cells = 27

    def __init__(self, settings: Mapping[str, Setting]) -> None:
        super().__init__(settings)
        self._place = Place()

    def begin(self) -> None:
        """Hear that an episode begins."""
        self._place = Place()

    def took(self, action: int) -> None:
        """Hear of a move."""
        name = ACTION_NAMES[action] if 0 <= action < len(ACTION_NAMES) else ""
        counted = {"X": "x", "Y": "y", "RZ": "turn"}.get(name[1:])
        if counted is not None:
            by = 1 if name[0] == "+" else -1
            self._place = self._place._replace(**{counted: getattr(self._place, counted) + by})

    def _key(self, unit: int) -> int:
        cell = 0
        for steps in self._place:
            aside = 0 if abs(steps) <= self._settings.cell_steps else 1 if steps > 0 else 2
            cell = 3 * cell + aside
        return unit * self._cells + cell


def _spread(index: NDArray[np.int64], count: int) -> NDArray[np.float64]:
    """Return where units stand at first along one input, shape (units,), in the middle of equal parts of -1 to 1."""
    return (2.0 * index + 1.0) / count - 1.0


def _block(snapshot: Mapping[str, object], key: str, items: int) -> bytes:
    value = snapshot[key]
    if not isinstance(value, bytes) or len(value) != items * _ITEM_BYTES:
        got = f"{len(value)} bytes" if isinstance(value, bytes) else type(value).__name__
        raise ValueError(f"SOM snapshot {key}: expected {items * _ITEM_BYTES} bytes, got {got}")
    return value
