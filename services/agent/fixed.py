"""Policies that learn nothing: force and torque in, an action or a move out. What a controller written by hand needs.

A subclass is a plug-in like any learner (docs/extending.md), so that a rule runs where a learner would: in a cell of
processes, on any arm, recorded, replayed and swapped. Together with ``classifier.kind = "none"`` there is nothing
between what is felt and what is done.
"""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from services.rules.bounds import Bounds
from services.rules.plugins import Lesson, Opinion, Proposal
from services.rules.wrench import Wrench
from services.wire.actions import Increment
from services.wire.definition import Policy, Setting


class _NothingLearnt:
    """The memory of who learns nothing."""

    states, version, episodes_before = 0, 0, 0

    def snapshot(self) -> dict[str, bytes | int]:
        """Return counts of 0."""
        return {"states": 0, "version": 0}

    def restore(self, snapshot: Mapping[str, bytes | int]) -> None:
        """Take over such a snapshot. Raises ValueError for another."""
        if dict(snapshot) != self.snapshot():
            raise ValueError(f"snapshot: expected that of a policy that learns nothing, got {sorted(snapshot)}")

    def digest(self) -> str:
        """Return the SHA-256, in hex, of the class's name."""
        return hashlib.sha256(type(self).__qualname__.encode()).hexdigest()


class FixedAction(_NothingLearnt, ABC):
    """A ``FeelingLearner`` that always answers the same to the same wrench: say which in ``action``."""

    def __init__(self, actions: int, settings: Mapping[str, Setting], policy: Policy, seed: int) -> None:
        """``actions`` is their number; settings are a subclass's own business, ValueError for any here."""
        if settings:
            raise ValueError(f"settings: expected none, got {', '.join(settings)}")
        self.actions = actions

    @abstractmethod
    def action(self, felt: Wrench) -> int:
        """Return the number of the move to make; below ``actions``."""

    @property
    def q(self) -> NDArray[np.float64]:
        """No values, shape (0, actions)."""
        return np.zeros((0, self.actions))

    @property
    def visits(self) -> NDArray[np.int64]:
        """No updates, shape (0, actions)."""
        return np.zeros((0, self.actions), np.int64)

    def values(self, state: int) -> NDArray[np.float64]:
        """Return zeros, shape (actions,): a state alone says nothing."""
        return np.zeros(self.actions)

    def chances(self, state: int, episode: int) -> NDArray[np.float64]:
        """Return zeros, shape (actions,)."""
        return np.zeros(self.actions)

    def best_action(self, state: int) -> int:
        """Return 0: a state alone says nothing."""
        return 0

    def decide(self, previous: tuple[int, int, float] | None, state: int, episode: int, step: int) -> int:
        """Refuse: without what is felt it cannot decide."""
        raise ValueError(f"state {state}: expected what was felt in it too, got none")

    def finish(self, previous: tuple[int, int, float]) -> None:
        """Learn nothing."""

    def decide_felt(self, previous: Lesson | None, state: int, felt: Wrench, episode: int, step: int) -> int:
        """Return the action. Raises ValueError for one that there is not."""
        number = self.action(felt)
        if not 0 <= number < self.actions:
            raise ValueError(f"action: expected 0 to {self.actions - 1}, got {number}")
        return number

    def finish_felt(self, previous: Lesson) -> None:
        """Learn nothing."""

    def opinion(self, state: int, felt: Wrench, episode: int) -> Opinion:
        """Return values of 0, but 1 for what would be done."""
        chosen, nothing = np.zeros(self.actions), np.zeros(self.actions)
        chosen[self.decide_felt(None, state, felt, episode, 0)] = 1.0
        return Opinion(chosen, chosen.copy(), nothing, nothing.copy(), chosen.copy())


class FixedMove(_NothingLearnt, ABC):
    """A ``ContinuousLearner`` that always makes the same move at the same wrench: say which in ``move``."""

    def __init__(self, bounds: Bounds, settings: Mapping[str, Setting], seed: int) -> None:
        """Settings are a subclass's own business, ValueError for any here."""
        if settings:
            raise ValueError(f"settings: expected none, got {', '.join(settings)}")
        self.bounds = bounds

    @abstractmethod
    def move(self, felt: Wrench) -> Increment:
        """Return the move to make, within ``bounds`` (``bounds.within`` makes such a one)."""

    def decide_move(self, previous: Lesson | None, state: int, felt: Wrench, episode: int, step: int) -> Increment:
        """Return the move."""
        return self.move(felt)

    def finish_move(self, previous: Lesson) -> None:
        """Learn nothing."""

    def proposal(self, state: int, felt: Wrench, episode: int) -> Proposal:
        """Return the move, and that nothing else is tried."""
        return Proposal(self.move(felt), Increment(), 0.0)
