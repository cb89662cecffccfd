"""What becomes of stored values that are not what was put: passed over, taken from elsewhere, or lost. Pure.

A checkpoint can be done without: the one before it and the journal say the same. So can ``latest``, which is said once
more under a number. What a run is, its episodes and its swaps are said once only, and so is the skill that the next run
begins with: with one of these damaged, a store would go on with less than it was given, and nobody would know.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

from services.wire.keys import (
    CHECKPOINT,
    CHOSEN_SKILL,
    ENTRY,
    NEWEST_CHECKPOINT,
    NEWEST_ENTRY,
    ROOT,
    SKILL,
    Named,
    named,
)
from services.wire.text import spans


class Mending(NamedTuple):
    """How to go on with a store in which some values are damaged."""

    drop: list[str]
    """Keys that are better empty."""
    copies: list[tuple[str, str]]
    """Keys whose value another one has once more: from, to."""
    lost: list[str]
    """Keys of values that nobody can replace."""


def mending(keys: Collection[str], damaged: Collection[str]) -> Mending:
    """Return what to do, given all stored keys and those of damaged values."""
    plan = Mending([], [], [])
    sound = sorted(set(keys) - set(damaged))
    for key in sorted(damaged):
        what = key_of(key)
        if what is None or what.pattern in (CHECKPOINT, SKILL):
            plan.drop.append(key)
        elif what.pattern in (NEWEST_CHECKPOINT, NEWEST_ENTRY):
            numbered = CHECKPOINT if what.pattern == NEWEST_CHECKPOINT else ENTRY
            same = [other for other in sound if _like(other, numbered, what, key)]
            if same:
                plan.copies.append((max(same), key))
            else:
                (plan.drop if numbered == CHECKPOINT else plan.lost).append(key)
        else:
            plan.lost.append(key)
    return plan


def words(keys: Collection[str], lost: Collection[str]) -> str:
    """Return what is lost, and what of the same run is sound."""
    parts = []
    for key in lost:
        what = key_of(key)
        assert what is not None
        if what.pattern == CHOSEN_SKILL:
            parts.append("the skill that the next run begins with")
            continue
        numbers = [there.episode for other in keys if other not in lost and (there := _like(other, ENTRY, what, key))]
        left = f"episodes {spans(number for number in numbers if number is not None)}" if numbers else "no episode"
        said = f"episode {what.episode}" if what.pattern == ENTRY else f"{what.pattern.rpartition('/')[2]}"
        parts.append(f"{said} of run {what.parts['run']}, of which {left} can still be had")
    return "; ".join(parts)


def key_of(key: str) -> Named | None:
    """Return which key of the contract a full key is."""
    return named(key.removeprefix(f"{ROOT}/").partition("/")[2])


def _like(key: str, pattern: str, what: Named, of: str) -> Named | None:
    """Return what a key is, if it is one of a pattern, of the same cell, run and service as the key ``of``."""
    there = key_of(key)
    if there is None or there.pattern != pattern or key.split("/")[1] != of.split("/")[1]:
        return None
    same = all(there.parts[part] == what.parts[part] for part in ("run", "service") if part in there.parts)
    return there if same else None
