"""The two reward functions of the thesis: what a decision earned, from the force before and after its move."""

from __future__ import annotations

from services.wire.actions import INSERT
from services.wire.definition import ForceChangeReward, InsertionReward, Reward


def reward_of_move(reward: Reward, action: int, force_before_n: float, force_after_n: float) -> float:
    """Return the reward of a move that did not end the episode badly.

    ``force_before_n`` (above 0, since decisions are taken in contact) and ``force_after_n`` are magnitudes [N].
    """
    if isinstance(reward, InsertionReward):
        return reward.insertion_step if action == INSERT else reward.step
    return _by_force_change(reward, force_before_n, force_after_n)


def _by_force_change(reward: ForceChangeReward, before_n: float, after_n: float) -> float:
    """Conference paper 2: by the relative change of the force over the move."""
    change = (after_n - before_n) / before_n
    if change <= -reward.fell_by:
        return reward.fell
    if change >= reward.rose_by:
        return reward.rose
    return reward.otherwise
