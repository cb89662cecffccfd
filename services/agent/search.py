"""Search over a flat face, where nothing that is felt says in which direction the hole lies: where to look next.

The peg's place is counted in lateral moves from the start of the episode: it is dead reckoning over the agent's own
moves, the only thing that is known of a position. Within an episode no place is looked at twice, and a place beside
others that were looked at is worth less: from there the hole's rim would have been felt. From episode to episode two
tables are kept: how often the peg went in at a place, and how often a place was looked at in vain. With nothing learnt
the way is about a spiral; where the hole is always at the same place, the next episode goes straight there; where it is
not, the search covers first where it mostly was. After search theory (Koopman 1957): the next place is the one with the
most chance of success for the way to it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from services.rules.wrench import Wrench
from services.wire.actions import Increment, increments, lateral_moves
from services.wire.definition import FeltModel, Moves

_FOUND = 8.0
"""What one success at a place counts, where the chance before any is 1/(1 + moves from the start)."""
_BESIDE = 0.5
"""Part of it that counts for each of the eight places around: dead reckoning errs by the wrist's give and by noise."""
FOUND, TRIED = "search_found", "search_tried"
"""Names of the two tables in a snapshot."""
_MOST = 1 << 53

_NOTHING_N = 0.1
"""A lateral force up to this may be noise."""

Place = tuple[int, int]


class FlatSearch:
    """Where to look next on a flat face, and what was learnt about that. A pure fold over the moves made."""

    def __init__(self, moves: Moves, radius: int) -> None:
        """Start with nothing learnt, for a search of ``radius`` lateral moves around the start.

        Raises ValueError when the moves have none along +X, -X, +Y or -Y alone.
        """
        self._steps = increments(moves)
        self.lateral = lateral_moves(moves)
        if len(self.lateral) < 4:
            raise ValueError("search: expected moves along +X, -X, +Y and -Y alone")
        self._pitch_mm = self._steps[self.lateral[1, 0]].dx_mm
        self._radius = radius
        size = 2 * radius + 1
        self._x, self._y = np.meshgrid(np.arange(size) - radius, np.arange(size) - radius, indexing="ij")
        self._before = 1.0 / (1.0 + np.maximum(abs(self._x), abs(self._y)))
        self.found = np.zeros((size, size), np.int64)
        """Episodes in which the peg went in at a place, shape (2 radius + 1, 2 radius + 1), by x and y."""
        self.tried = np.zeros((size, size), np.int64)
        """Episodes in which a place was looked at and the peg did not go in there; of the same shape."""
        self._weight = self._before
        self._seen: set[Place] = set()
        self._x_mm = self._y_mm = 0.0

    @property
    def place(self) -> Place:
        """Where the peg is, in lateral moves from the start of the episode."""
        return round(self._x_mm / self._pitch_mm), round(self._y_mm / self._pitch_mm)

    def begin(self) -> None:
        """Begin an episode: at the start, with nothing looked at."""
        self._seen.clear()
        self._x_mm = self._y_mm = 0.0
        self._weight = self._weigh()

    def look(self) -> None:
        """Take it that the peg is pressed on where it is now, and the hole is not there."""
        self._seen.add(self.place)

    def took(self, action: int) -> None:
        """Follow a move."""
        step = self._steps[action]
        self._x_mm += step.dx_mm
        self._y_mm += step.dy_mm

    def next_move(self) -> int:
        """Return the lateral move towards the place that is worth most for the way to it."""
        here_x, here_y = self.place
        worth = self._weight / (1.0 + abs(self._x - here_x) + abs(self._y - here_y))
        seen = self._grid(self._seen)
        worth = np.where(seen > 0, 0.0, worth / (1.0 + _around(seen)))
        best = int(worth.argmax())
        dx, dy = int(self._x.flat[best]) - here_x, int(self._y.flat[best]) - here_y
        if abs(dx) >= abs(dy):
            return self.lateral[1 if dx > 0 else -1, 0]
        return self.lateral[0, 1 if dy > 0 else -1]

    def finish(self, inserted: bool) -> None:
        """Learn from an episode: where the peg went in, if it did, and where it was looked for in vain."""
        here = self.place
        if inserted:
            self._seen.discard(here)
            self.found += self._grid({here})
        self.tried += self._grid(self._seen)
        self._seen.clear()

    def snapshot(self) -> dict[str, bytes]:
        """Return both tables, as little-endian i64, row by row."""
        return {FOUND: self.found.astype("<i8").tobytes(), TRIED: self.tried.astype("<i8").tobytes()}

    def restore(self, snapshot: Mapping[str, object]) -> None:
        """Take over a ``snapshot``, with an episode about to begin; of a search of another radius what both reach.

        ValueError, with nothing changed, if it is none.
        """
        self.found, self.tried = (self._table(snapshot.get(name), name) for name in (FOUND, TRIED))
        self.begin()

    def _weigh(self) -> NDArray[np.float64]:
        """Return the chance, up to a factor, of each place."""
        near = self.found + _BESIDE * _around(self.found)
        weight: NDArray[np.float64] = (self._before + _FOUND * near) / (1.0 + self.tried)
        return weight

    def _grid(self, places: set[Place]) -> NDArray[np.int64]:
        """Return 1 for each of these places within the radius, else 0, of the tables' shape."""
        grid, radius = np.zeros_like(self.found), self._radius
        for x, y in places:
            if max(abs(x), abs(y)) <= radius:
                grid[x + radius, y + radius] = 1
        return grid

    def _table(self, value: object, name: str) -> NDArray[np.int64]:
        """Return a table of counts from a snapshot's bytes. Raises ValueError."""
        size = len(value) // 8 if isinstance(value, bytes) and len(value) % 8 == 0 else 0
        side = math.isqrt(size)
        if not isinstance(value, bytes) or side * side != size or side % 2 == 0:
            got = f"{len(value)} bytes" if isinstance(value, bytes) else type(value).__name__
            raise ValueError(f"snapshot: expected {name} to be a square of counts with a middle, got {got}")
        counts = np.frombuffer(value, "<i8").astype(np.int64).reshape(side, side)
        if (counts < 0).any() or (counts > _MOST).any():
            raise ValueError(f"snapshot: expected counts of 0 or more as {name}, got others")
        table, theirs = np.zeros_like(self.found), side // 2
        both = min(self._radius, theirs)
        ours = slice(self._radius - both, self._radius + both + 1)
        of_theirs = slice(theirs - both, theirs + both + 1)
        table[ours, ours] = counts[of_theirs, of_theirs]
        return table


def _around(grid: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return for each place the sum over the eight places around it."""
    rows, columns = grid.shape
    padded = np.pad(grid, 1)
    beside = [(i, j) for i in (0, 1, 2) for j in (0, 1, 2) if (i, j) != (1, 1)]
    total = np.zeros_like(grid)
    for i, j in beside:
        total += padded[i : i + rows, j : j + columns]
    return total


class FlatFace:
    """When to search, and when to leave it to what was learnt: on a flat face, friction is all that is felt aside."""

    def __init__(self, moves: Moves, learner: FeltModel) -> None:
        """Start with nothing learnt. Raises ValueError when there are no moves to search with."""
        self.search = FlatSearch(moves, learner.search_moves)
        self._learner = learner
        steps = increments(moves)
        self._turns = [action for action, step in enumerate(steps) if _turns(step)]
        self._inserts = [action for action, step in enumerate(steps) if step.dz_mm > 0.0 and not _turns(step)]
        self._episode: int | None = None

    def decide(self, action: int, values: NDArray[np.float64], felt: Wrench, episode: int) -> int:
        """Return the move to make where the learner would make ``action``, and follow it.

        ``values`` is what each move is taken to be worth, shape (actions,). What is felt aside may be friction alone:
        then a turn that is worth it comes first, a step inwards if the contact is light, or else the search goes on.
        """
        if episode != self._episode:
            self._episode = episode
            self.search.begin()
        learner, (fx, fy, fz) = self._learner, felt.force_n
        self.search.look()
        if math.hypot(fx, fy) <= learner.search_cone * abs(fz) + _NOTHING_N:
            turn = max(self._turns, key=lambda turn: float(values[turn]), default=None)
            if turn is not None and values[turn] >= learner.search_turn:
                action = turn
            elif self._inserts and -fz < learner.search_press_n:
                action = self._inserts[0]
            else:
                action = self.search.next_move()
        self.search.took(action)
        return action


def _turns(step: Increment) -> bool:
    """Return whether a move turns about a lateral axis, and does nothing else."""
    return bool(step.rx_deg or step.ry_deg) and not any((step.dx_mm, step.dy_mm, step.dz_mm, step.rz_deg))
