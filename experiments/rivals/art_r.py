"""ART-R's output layer: stochastic units over the classes of a Fuzzy ART module, taught by REINFORCE (Brignone).

A class adds its weight to each move, a stochastic switch draws one of them, and the reward of that one move, less what
is usual in that class, shifts the weights along the gradient of the move's chance (Williams 1992). Nothing is carried
back from later rewards: ART-R learns which move takes load off at once.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from typing import Annotated

import msgspec
import numpy as np

from services.agent.learning import Learner
from services.rules.plugins import settings_as
from services.wire.definition import Policy, QLearning, Setting

_ITEM_BYTES = 8


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the plug-in ``art-r``."""

    alpha: Annotated[float, msgspec.Meta(gt=0, le=10)] = 0.1
    """Learning rate of the weights."""
    beta: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.1
    """Learning rate of what is usual in a class."""
    reward_limit: Annotated[float, msgspec.Meta(gt=0, le=1e6)] = 10.0
    """Most, up or down, that one reward counts as."""


class ArtR(Learner):
    """Weights of each class, shape (states, moves), in ``q``; the policy makes chances of them.

    With the policy softmax and beta = 1 it is the stochastic switch; greedy is what was learnt without the dice.
    """

    def __init__(self, actions: int, settings: Mapping[str, Setting], policy: Policy, seed: int) -> None:
        """Make a layer with all weights 0. Raises ValueError for wrong settings."""
        super().__init__(actions, QLearning(), policy, seed)
        self._settings = settings_as(Settings, settings)
        self._usual = np.zeros(0)

    def update(self, state: int, action: int, reward: float, next_state: int | None, next_action: int | None) -> None:
        """Learn from the reward of one move; what came after it does not count. Raises ValueError."""
        chances = self.chances(state, 0)
        self._valid_action(action, "action")
        if not math.isfinite(reward):
            raise ValueError(f"reward in state {state}: expected a finite number, got {reward}")
        settings = self._settings
        told = min(settings.reward_limit, max(-settings.reward_limit, reward))
        self._grow(state + 1)
        if self._states > len(self._usual):
            self._usual = np.pad(self._usual, (0, self._states - len(self._usual)))
        better = told - float(self._usual[state])
        self._q[state] -= settings.alpha * better * chances
        self._q[state, action] += settings.alpha * better
        self._usual[state] += settings.beta * better
        self._visits[state, action] += 1
        self._version += 1

    def snapshot(self) -> dict[str, bytes | int]:
        """Return weights as ``Learner`` does its table, and what is usual in each class."""
        return {**super().snapshot(), "usual": self._usual.astype("<f8").tobytes()}

    def restore(self, snapshot: Mapping[str, object]) -> None:
        """Take over a ``snapshot``, to the last bit. ValueError, with nothing changed, when it does not fit."""
        table = dict(snapshot)
        usual = table.pop("usual", None)
        states = table.get("states")
        if not isinstance(usual, bytes) or not isinstance(states, int) or len(usual) != states * _ITEM_BYTES:
            raise ValueError(f"snapshot: expected what is usual in each of {states} states, got {type(usual).__name__}")
        numbers = np.frombuffer(usual, "<f8").astype(np.float64)
        if not np.isfinite(numbers).all():
            raise ValueError("snapshot: expected finite numbers as usual rewards, got others")
        super().restore(table)
        self._usual = numbers

    def digest(self) -> str:
        """Return the SHA-256, in hex, of weights and usual rewards."""
        return hashlib.sha256(super().digest().encode() + self._usual.astype("<f8").tobytes()).hexdigest()
