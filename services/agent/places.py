"""Where the peg was in this episode, by dead reckoning over the agent's own moves: what was visited, and how often.

A place is what all moves that were decided add up to, turns too. The task's own steps do not count, nor does the
wrist's give: it is a place of the arm, and no position is measured.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.wire.actions import GRID, Increment, increments
from services.wire.definition import Moves

_BITS = 64
"""Room for each axis in the number of a place: no sum of moves in an episode comes near it."""


class Places:
    """Visits of each place of an episode. A pure fold over the moves made in it."""

    def __init__(self, moves: Moves) -> None:
        """Start at the first place, which counts as visited when a move leads back to it."""
        self._steps = [_number(step) for step in increments(moves)]
        self._here = 0
        self._visits: dict[int, int] = {}
        self._episode: int | None = None

    def ahead(self, episode: int) -> NDArray[np.float64]:
        """Return how often in this episode a move led to where each would lead now, shape (actions,)."""
        if episode != self._episode:
            self._episode, self._here = episode, 0
            self._visits.clear()
        here, visits = self._here, self._visits
        return np.array([visits.get(here + step, 0) for step in self._steps], np.float64)

    def took(self, action: int) -> None:
        """Follow a move."""
        self._here += self._steps[action]
        self._visits[self._here] = self._visits.get(self._here, 0) + 1


def _number(step: Increment) -> int:
    """Return a move as one number, so that sums of moves are equal just where they lead to the same place."""
    return sum(round(10.0**GRID * part) << (_BITS * axis) for axis, part in enumerate(step))
