"""What an agent of one's own feels and may do: observations and actions as arrays."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from msgspec.structs import replace

from services.rules.bounds import Bounds
from services.sim.pose import Pose, rotation_vector
from services.wire.actions import Increment, increments
from services.wire.definition import Continuous, Definition
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
    """Any increment within ``moves.continuous``: every component from -1 to 1 is from its least to its greatest value.

    Along Z, where there is no way back, -1 stays and 1 is the greatest step of insertion. What would add more force
    than the most forceful move of the list is made shorter, all components alike: no arm would take it otherwise
    (docs/decisions/0011).
    """

    def __init__(self, definition: Definition) -> None:
        self._bounds = Bounds(definition)
        size = len(self._bounds.axes)
        self.space = spaces.Box(-np.ones(size, np.float32), np.ones(size, np.float32), dtype=np.float32)

    def move(self, action: object) -> tuple[int, Increment | None]:
        """Return the increment, and the move of the list that it counts as."""
        increment = self._bounds.within(np.asarray(action, dtype=np.float64).tolist())
        return self._bounds.counts_as(increment), increment


def with_bounds(definition: Definition) -> Definition:
    """Return a definition with bounds of moves: its own, or those within which the moves of its list are."""
    if definition.moves.continuous.any:
        return definition
    table = np.array(increments(definition.moves), dtype=np.float64)
    x_mm, y_mm, _, rx_deg, ry_deg, rz_deg = np.abs(table).max(axis=0).tolist()
    back_mm, z_mm = float(max(0.0, -table[:, 2].min())), float(table[:, 2].max())
    most = Continuous(x_mm=x_mm, y_mm=y_mm, z_mm=z_mm, back_mm=back_mm, rx_deg=rx_deg, ry_deg=ry_deg, rz_deg=rz_deg)
    return replace(definition, moves=replace(definition.moves, continuous=most))
