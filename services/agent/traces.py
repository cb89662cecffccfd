"""Eligibility traces: which earlier decisions of the episode share in a lesson, and how much. Pure.

Replacing traces (Singh and Sutton 1996): the last decision's share is 1, whatever it was before; with each lesson all
shares fall by gamma * lambda. Nothing of them outlives the episode, so that they are in no snapshot.
"""

from __future__ import annotations

from collections.abc import Iterator

SMALLEST = 0.01
"""A smaller share is none."""


class Traces:
    """The shares of one episode; ``decay`` is gamma * lambda, above 0."""

    def __init__(self, decay: float) -> None:
        self._decay = decay
        self._shares: dict[tuple[int, int], float] = {}
        """By state and action, the oldest first."""

    def mark(self, state: int, action: int) -> None:
        """Give a decision its whole share."""
        self._shares.pop((state, action), None)
        self._shares[state, action] = 1.0

    def shares(self) -> Iterator[tuple[int, int, float]]:
        """Give state, action and share of each decision, the oldest first."""
        for (state, action), share in self._shares.items():
            yield state, action, share

    def fall(self) -> None:
        """Let a lesson be over."""
        fallen = ((place, self._decay * share) for place, share in self._shares.items())
        self._shares = {place: share for place, share in fallen if share >= SMALLEST}

    def clear(self) -> None:
        """Forget all: the episode is over, or what follows is not what the table would have done."""
        self._shares.clear()
