"""A learner of one's own: Q-learning that takes the mean of the two best moves for what comes next."""

from collections.abc import Mapping

import numpy as np

from services.agent.learning import Learner
from services.rules.plugins import settings_as
from services.wire.definition import Policy, QLearning, Setting


class TwoBest(Learner):
    """One-step learner; settings alpha and gamma as for Q-learning."""

    def __init__(self, actions: int, settings: Mapping[str, Setting], policy: Policy, seed: int) -> None:
        super().__init__(actions, settings_as(QLearning, settings), policy, seed)

    def next_value(self, state: int, action: int | None) -> float:
        """Return what it is worth to come to a state."""
        return float(np.sort(self.values(state))[-2:].sum() / 2)
