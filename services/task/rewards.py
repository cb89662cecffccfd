"""What a decision earned: the two reward functions of the thesis, by its move and the force before and after it.

And what may be added to either: success, and a price of force.
"""

from __future__ import annotations

import math

from services.rules.wrench import Reference
from services.wire.definition import Definition, ForceChangeReward, InsertionReward, Reward
from services.wire.messages import Force, Outcome, Torque


def reward_of_move(reward: Reward, dz_mm: float, force_before_n: float, force_after_n: float) -> float:
    """Return the reward of a move that goes so far in +Z [mm] and did not end the episode badly.

    ``force_before_n`` (above 0, since decisions are taken in contact) and ``force_after_n`` are magnitudes [N].
    """
    if dz_mm < 0.0:
        return reward.back
    if isinstance(reward, InsertionReward):
        return reward.insertion_step if dz_mm > 0.0 else reward.step
    return _by_force_change(reward, force_before_n, force_after_n)


def end_reward(reward: Reward, outcome: Outcome, otherwise: float) -> float:
    """Return the reward of the move that an episode ended with, which would have earned ``otherwise``.

    An episode that was over at the first touch, without a decision, counts as much.
    """
    if outcome == "collision":
        return reward.collision
    if outcome == "no_progress":
        return reward.no_progress
    return otherwise + reward.success if outcome == "inserted" else otherwise


def cost_of_force(reward: Reward, force_n: float) -> float:
    """Return what the force [N] that a move leaves costs, to be taken off its reward where the episode goes on."""
    return reward.force_per_n * force_n if isinstance(reward, InsertionReward) else 0.0


class Potential:
    """The price of force of one definition, as a difference of potentials; see ``Shaping``."""

    def __init__(self, definition: Definition) -> None:
        self._shaping = definition.shaping
        self._reference = Reference(definition)

    def of(self, force_n: Force, torque_nm: Torque) -> float:
        """Return Phi [N] of a sample as it is read; 0 where there is no price. An episode ends at 0."""
        if self._shaping.price_per_n == 0.0:
            return 0.0
        force, torque = self._reference.felt(force_n, torque_nm)
        return math.hypot(*force) + self._shaping.torque_per_m * math.hypot(*torque)

    def price(self, dz_mm: float, before: float, after: float) -> float:
        """Return what is added to the reward of a decision between two potentials [N]; it leads so far in +Z [mm].

        A move back out has a fixed reward: paid for the force that it takes off, it would be made again and again.

        With noise, both decisions see Phi of the very sample that was observed there, so that over an episode all but
        the first cancels out.
        """
        return 0.0 if dz_mm < 0.0 else self._shaping.price_per_n * (before - self._shaping.gamma * after)


def _by_force_change(reward: ForceChangeReward, before_n: float, after_n: float) -> float:
    """Conference paper 2: by the relative change of the force over the move."""
    change = (after_n - before_n) / before_n
    if change <= -reward.fell_by:
        return reward.fell
    if change >= reward.rose_by:
        return reward.rose
    return reward.otherwise
