"""The thesis's two grid worlds, maze and cliff, and a loop that trains a learner in one (thesis 4.5.1).

The agent sees only which of the four squares around it are walls, so squares that look alike are one state: bits
N 1, W 2, E 4, S 8, hence states 0..15 (thesis Fig. 4.13). Cliff squares and the world's border look like walls.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from services.agent.learning import Learner


class Move(IntEnum):
    """The four actions."""

    NORTH = 0
    EAST = 1
    SOUTH = 2
    WEST = 3


OFFSETS = {Move.NORTH: (-1, 0), Move.EAST: (0, 1), Move.SOUTH: (1, 0), Move.WEST: (0, -1)}
"""Where each move leads: (rows, columns)."""
WALL_BITS = {Move.NORTH: 1, Move.WEST: 2, Move.EAST: 4, Move.SOUTH: 8}
"""What a wall in each direction adds to the state."""

MAZES = {
    "narrow": """
        S####
        .#...
        ...#.
        ...#.
        ...#G
    """,
    "wide": """
        S#...
        ...#.
        ...#.
        ...#.
        ...#G
    """,
}
"""Fig. 4.12 is lost; these are the two mazes that agree with Table 4.1, the ten-move path and the states met."""
CLIFF = """
    ..........
    ..........
    ..........
    S.xxxxxxxG
"""
"""The cliff walk of Fig. 4.16: 11 moves along the edge, 15 along the top."""

MOVE_REWARD, GOAL_REWARD, FALL_REWARD = -1.0, 0.0, -100.0


class World(Protocol):
    """A world of numbered states in which the four moves are made."""

    @property
    def fell(self) -> bool:
        """Whether the episode ended over the edge of a cliff."""

    def reset(self) -> int:
        """Begin an episode and return its first state."""

    def step(self, action: int) -> tuple[int, float, bool]:
        """Make one ``Move``; return the new state, the reward and whether the episode is over."""


class GridWorld:
    """A world drawn as text: S start, G goal, # wall, x cliff, . free; all around it is wall.

    A move into a wall leaves the agent where it is. Every move earns -1, the one that reaches the goal 0, the one
    over the edge -100; the last two end the episode.
    """

    def __init__(self, layout: str, sees: Literal["walls", "square"] = "walls") -> None:
        """Read a layout of equally long lines with one S and one G; ValueError otherwise.

        ``sees`` says what the state tells: the walls around, as in the thesis, or which square it is, counted from
        the top left, which takes away the thesis's confusion of squares that look alike.
        """
        lines = layout.split()
        drawn = "".join(lines)
        if len({len(line) for line in lines}) != 1 or set(drawn) - set("SG#x."):
            raise ValueError(f"layout: expected equally long lines of the squares SG#x., got {lines}")
        if drawn.count("S") != 1 or drawn.count("G") != 1:
            raise ValueError(f"layout: expected one S and one G, got {lines}")
        self._squares = {(row, column): s for row, line in enumerate(lines) for column, s in enumerate(line)}
        self._start = next(at for at, square in self._squares.items() if square == "S")
        self._at = self._start
        self._ended = True
        self._sees = sees

    @property
    def square(self) -> str:
        """The kind of square the agent is on; ``x`` after a fall."""
        return self._squares[self._at]

    @property
    def fell(self) -> bool:
        """Whether the agent went over the edge."""
        return self.square == "x"

    def reset(self) -> int:
        """Put the agent on S and return its state."""
        self._at = self._start
        self._ended = False
        return self._state()

    def step(self, action: int) -> tuple[int, float, bool]:
        """Make one ``Move``; return the new state, the reward and whether the episode is over.

        ValueError when ``action`` is no Move or the episode is over.
        """
        if self._ended:
            raise ValueError("grid world: expected a reset before the next move, got a move after the end")
        there = self._neighbour(Move(action))
        if self._squares.get(there, "#") != "#":
            self._at = there
        self._ended = self.square in "Gx"
        reward = {"G": GOAL_REWARD, "x": FALL_REWARD}.get(self.square, MOVE_REWARD)
        return self._state(), reward, self._ended

    def _neighbour(self, move: Move) -> tuple[int, int]:
        rows, columns = OFFSETS[move]
        return self._at[0] + rows, self._at[1] + columns

    def _state(self) -> int:
        if self._sees == "square":
            return list(self._squares).index(self._at)
        return sum(bit for move, bit in WALL_BITS.items() if self._squares.get(self._neighbour(move), "#") in "#x")


@dataclass(frozen=True)
class Training:
    """What came of each episode; all of shape (episodes,)."""

    returns: NDArray[np.float64]
    """Sum of the rewards, undiscounted."""
    steps: NDArray[np.int64]
    """Number of moves."""
    falls: NDArray[np.bool_]
    """Whether it ended over the edge of the cliff."""


def train(world: World, learner: Learner, episodes: int, start_episode: int = 0, step_limit: int = 1000) -> Training:
    """Let ``learner`` (of 4 actions) live through ``episodes`` episodes in ``world``, numbered from ``start_episode``.

    An episode is broken off after ``step_limit`` moves (the thesis's cliff: 1000); its last move is still learnt
    from, as one that led on.
    """
    returns, steps, falls = np.zeros(episodes), np.zeros(episodes, np.int64), np.zeros(episodes, np.bool_)
    for index in range(episodes):
        state = world.reset()
        previous: tuple[int, int, float] | None = None
        for step in range(step_limit + 1):
            action = learner.decide(previous, state, start_episode + index, step)
            if step == step_limit:
                break
            before = state
            state, reward, ended = world.step(action)
            previous = before, action, reward
            returns[index] += reward
            steps[index] += 1
            if ended:
                learner.finish(previous)
                break
        falls[index] = world.fell
    return Training(returns, steps, falls)


def greedy_path(world: World, learner: Learner, step_limit: int = 100) -> list[tuple[int, Move]]:
    """Return the (state, move) pairs from S on when the best-valued action is always taken; learns nothing.

    Ends with the episode or after ``step_limit`` moves, which is how a policy that runs in circles shows.
    """
    path: list[tuple[int, Move]] = []
    state, ended = world.reset(), False
    while not ended and len(path) < step_limit:
        move = Move(learner.best_action(state))
        path.append((state, move))
        state, _, ended = world.step(move)
    return path
