"""A worker's place in its run, kept in the snapshot beside what it has learnt."""

from __future__ import annotations

from collections.abc import Mapping

_DECISIONS, _EPISODE = "fold_decisions", "fold_episode"

Memory = dict[str, bytes | int]


def with_place(learnt: Mapping[str, bytes | int], decisions: int, episode: int) -> Memory:
    """Return a snapshot of what was learnt up to a place."""
    return {**learnt, _DECISIONS: decisions, _EPISODE: episode}


def split_place(snapshot: Mapping[str, bytes | int], whose: str) -> tuple[Memory, int, int]:
    """Return what was learnt, and the decisions and the episode of the place. Raises ValueError without a place."""
    memory = dict(snapshot)
    decisions, episode = memory.pop(_DECISIONS, None), memory.pop(_EPISODE, None)
    if not (isinstance(decisions, int) and isinstance(episode, int) and decisions >= 0 <= episode):
        raise ValueError(f"{whose} checkpoint: expected {_DECISIONS} and {_EPISODE} of 0 or more")
    return memory, decisions, episode
