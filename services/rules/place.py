"""A worker's place in its run, kept in the snapshot beside what it has learnt."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

_DECISIONS, _EPISODE, _SWAPS = "fold_decisions", "fold_episode", "fold_swaps"

Memory = dict[str, bytes | int]


class Place(NamedTuple):
    """Where a worker stands between two episodes."""

    decisions: int
    """Decisions folded so far."""
    episode: int
    """Episode of the last of them."""
    swaps: int
    """Swaps that the memory includes."""


def with_place(learnt: Mapping[str, bytes | int], place: Place) -> Memory:
    """Return a snapshot of what was learnt up to a place."""
    return {**learnt, _DECISIONS: place.decisions, _EPISODE: place.episode, _SWAPS: place.swaps}


def split_place(snapshot: Mapping[str, bytes | int], whose: str) -> tuple[Memory, Place]:
    """Return what was learnt, and the place. Raises ValueError without one."""
    memory = dict(snapshot)
    numbers = [memory.pop(name, None) for name in (_DECISIONS, _EPISODE, _SWAPS)]
    decisions, episode, swaps = (number if isinstance(number, int) else -1 for number in numbers)
    if min(decisions, episode, swaps) < 0:
        raise ValueError(f"{whose} checkpoint: expected {_DECISIONS}, {_EPISODE} and {_SWAPS} of 0 or more")
    return memory, Place(decisions, episode, swaps)
