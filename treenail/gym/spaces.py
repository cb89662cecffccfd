"""What an agent of one's own feels and may do: observations and actions as arrays."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from services.sim.pose import Pose, rotation_vector
from services.wire.actions import Increment, increments
from services.wire.definition import Definition
from services.wire.force_bound import ForceBound
from services.wire.message_base import LARGEST_COMPONENT

Array = npt.NDArray[np.float32]
WRENCH = 6
TURN = 3
MOST_HISTORY = 1000


class Feeling:
    """Observations: what the wrist feels, newest first, and then how the tool is turned."""

    def __init__(self, history: int, orientation: bool) -> None:
        """``history``: wrenches of decisions before that are felt along; ``orientation``: whether the turn is too."""
        self._orientation = orientation
        self._wrenches: deque[tuple[float, ...]] = deque(maxlen=history + 1)
        bounds = [LARGEST_COMPONENT] * (WRENCH * (history + 1)) + [np.pi] * (TURN * orientation)
        high = np.array(bounds, dtype=np.float32)
        self.space = spaces.Box(-high, high, dtype=np.float32)

    def begin(self) -> None:
        """Begin an episode: nothing was felt before."""
        for _ in range(self._wrenches.maxlen or 0):
            self._wrenches.append((0.0,) * WRENCH)

    def feel(self, force_n: Sequence[float], torque_nm: Sequence[float], commanded: Pose) -> Array:
        """Return the observation, shape (6 (history + 1) [+ 3],).

        Force [N] and torque [N m], each shape (3,), in the tool frame; the tool's turn is a rotation vector [rad] as
        commanded: an arm knows it.
        """
        self._wrenches.appendleft((*force_n, *torque_nm))
        felt = [value for wrench in self._wrenches for value in wrench]
        if self._orientation:
            felt += rotation_vector(commanded.orientation)
        return np.array(felt, dtype=np.float32)


class ListedMoves:
    """One of the definition's moves, by its number."""

    def __init__(self, definition: Definition) -> None:
        self._increments = increments(definition.moves)
        self.space = spaces.Discrete(len(self._increments))

    def move(self, action: object) -> tuple[int, Increment | None]:
        """Return the number of the move; None: it is the list's."""
        return int(action), None  # type: ignore[call-overload]


class AnyMoves:
    """Any increment within those of the list: every component from -1 to 1 is from its least to its greatest value.

    Along Z, where the list has no way back, -1 stays and 1 is a whole step of insertion. What would add more force than
    the most forceful move of the list is made shorter, all components alike: no arm would take it otherwise
    (docs/decisions/0011).
    """

    def __init__(self, definition: Definition) -> None:
        table = np.array(increments(definition.moves), dtype=np.float64)
        low, high = np.minimum(table.min(axis=0), 0.0), np.maximum(table.max(axis=0), 0.0)
        self._axes = np.flatnonzero(high > low)
        self._low, self._high = low, high
        self._bound = ForceBound(definition)
        self._unmoved_n = self._bound.added_n(Increment())
        self._half_step_mm = high[2] / 2
        depths = [float(row[2]) for row in table]
        aside = next((number for number, depth in enumerate(depths) if depth == 0.0), 0)
        self._aside = aside
        self._deeper = next((number for number, depth in enumerate(depths) if depth > 0.0), aside)
        self._back = next((number for number, depth in enumerate(depths) if depth < 0.0), aside)
        size = len(self._axes)
        self.space = spaces.Box(-np.ones(size, np.float32), np.ones(size, np.float32), dtype=np.float32)

    def move(self, action: object) -> tuple[int, Increment | None]:
        """Return the increment, and the move of the list that it counts as.

        With half a step of +Z or more it counts as one of insertion, for the reward and for the no-progress rule; with
        any of -Z as one back out.
        """
        parts = np.zeros(6)
        share = (np.asarray(action, dtype=np.float64) + 1.0) / 2.0
        parts[self._axes] = self._low[self._axes] + share * (self._high - self._low)[self._axes]
        added_n = self._bound.added_n(Increment(*parts.tolist())) - self._unmoved_n
        most_n = self._bound.largest_n - self._unmoved_n
        if added_n > most_n:
            parts *= most_n / added_n
        deeper, back = parts[2] >= self._half_step_mm > 0.0, parts[2] < 0.0
        counts_as = self._deeper if deeper else self._back if back else self._aside
        return counts_as, Increment(*parts.tolist())
