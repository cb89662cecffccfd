"""Gymnasium's CliffWalking-v1 for the grid worlds' training loop: an environment that others know by its numbers."""

from __future__ import annotations

import gymnasium


class CliffWalking:
    """Four rows of twelve squares, told apart by number; its moves are numbered like ours (north, east, south, west).

    Every move earns -1, also the last one. One over the edge earns -100 and leads back to the start, without an end.
    """

    fell = False
    """No episode ends over the edge."""

    def __init__(self) -> None:
        self._made = gymnasium.make("CliffWalking-v1")

    def reset(self) -> int:
        """Put the agent on the start and return its square."""
        square, _ = self._made.reset(seed=0)
        return int(square)

    def step(self, action: int) -> tuple[int, float, bool]:
        """Make one ``Move``; return the new square, the reward and whether the episode is over."""
        square, reward, ended, broken_off, _ = self._made.step(int(action))
        return int(square), float(reward), ended or broken_off
