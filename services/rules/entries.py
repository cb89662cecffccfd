"""The decisions of a journal entry as the messages that they were."""

from __future__ import annotations

from typing import Any

from services.wire.messages import JournalEpisode, Observation, Reward, State


def observation_in(entry: JournalEpisode, index: int) -> Observation:
    """Return the sample of the entry's decision ``index``, counted from 0."""
    step = entry.steps[index]
    previous = entry.steps[index - 1].action if index else None
    place = _place(entry, index)
    return Observation(**place, force_n=step.force_n, torque_nm=step.torque_nm, previous_action=previous)


def state_in(entry: JournalEpisode, index: int, state: int) -> State:
    """Return what was classified, as far as a journal has it: how well it matched is not in it."""
    felt, place = entry.steps[index], _place(entry, index)
    return State(**place, state=state, states=state + 1, match=0.0, force_n=felt.force_n, torque_nm=felt.torque_nm)


def reward_in(entry: JournalEpisode, index: int, reward: float) -> Reward:
    """Return the reward of a decision: the last of a finished episode says how it ended."""
    ended = entry.summary is not None and index == len(entry.steps) - 1
    terminal = entry.summary.outcome if ended and entry.summary is not None else None
    return Reward(**_place(entry, index), reward=reward, terminal=terminal)


def _place(entry: JournalEpisode, index: int) -> dict[str, Any]:
    return {
        "run": entry.run,
        "episode": entry.episode,
        "step": entry.steps[index].step,
        "decision": entry.first_decision + index,
        "swaps": entry.swaps,
    }
