"""What of an episode in the journal can be checked without physics and without a worker's memory. Pure.

The journal has no motion between two decisions and no force after the last one, so rewards and summary are held against
what is known: exactly where that decides, as a bound where it does not.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from services.task.rewards import reward_of_move
from services.wire.actions import INSERT
from services.wire.definition import Definition, InsertionReward
from services.wire.messages import EpisodeSummary, JournalStep

_ROUNDING = 1e-9
"""Relative room for a mean that is multiplied by its count again."""


class Trouble(NamedTuple):
    """Something in the journal that cannot be so."""

    field: str
    expected: str
    got: str


def reward_trouble(
    definition: Definition, steps: Sequence[JournalStep], index: int, summary: EpisodeSummary
) -> Trouble | None:
    """Return what is wrong with the reward of a step of a finished episode, given the definition's reward function."""
    step = steps[index]
    allowed = _rewards(definition, steps, index, summary)
    if step.reward in allowed:
        return None
    return Trouble("reward", " or ".join(repr(value) for value in sorted(allowed)), repr(step.reward))


def step_troubles(definition: Definition, steps: Sequence[JournalStep], index: int) -> Iterator[Trouble]:
    """Give what is wrong with the place and the force of a step."""
    step, limits = steps[index], definition.limits
    least = steps[index - 1].step + 1 if index else 0
    if step.step < least:
        yield Trouble("step", f"{least} or more", str(step.step))
    force_n = math.hypot(*step.force_n)
    if not limits.contact_force_n <= force_n < limits.collision_force_n:
        expected = f"a force from {limits.contact_force_n:g} to below {limits.collision_force_n:g} N"
        yield Trouble("force_n", expected, f"{force_n:g} N")


def summary_troubles(
    definition: Definition, steps: Sequence[JournalStep], summary: EpisodeSummary, known_states: int
) -> Iterator[Trouble]:
    """Give what in a summary does not add up; ``known_states`` are those that the task had seen before the episode."""
    states = max([known_states, *(step.state + 1 for step in steps if step.state is not None)])
    exact = (
        ("decisions", len(steps), summary.decisions),
        ("episode_return", _return(definition, steps, summary), summary.episode_return),
        ("states", states, summary.states),
    )
    for field, expected, got in exact:
        if expected != got:
            yield Trouble(field, repr(expected), repr(got))
    yield from _moves(definition, steps, summary)
    yield from _magnitudes(definition, steps, summary)


def _rewards(
    definition: Definition, steps: Sequence[JournalStep], index: int, summary: EpisodeSummary
) -> frozenset[float]:
    """Return what a step may have earned."""
    reward, step = definition.reward, steps[index]
    last = index == len(steps) - 1
    penalties = {"collision": reward.collision, "no_progress": reward.no_progress}
    if last and summary.outcome in penalties:
        return frozenset({penalties[summary.outcome]})
    if isinstance(reward, InsertionReward):
        return frozenset({reward.insertion_step if step.action == INSERT else reward.step})
    before_n, contact_n = math.hypot(*step.force_n), definition.limits.contact_force_n
    if not last and steps[index + 1].step == step.step + 1:
        after_n = [math.hypot(*steps[index + 1].force_n)]
    elif not last or summary.moves > step.step + 1:
        after_n = [0.0, math.nextafter(contact_n, 0.0)]  # guidance went on: the force had fallen below contact
    else:
        return frozenset({reward.fell, reward.rose, reward.otherwise})
    return frozenset(reward_of_move(reward, step.action or 0, before_n, force_n) for force_n in after_n)


def _return(definition: Definition, steps: Sequence[JournalStep], summary: EpisodeSummary) -> float:
    """Return the sum of the rewards, added in their order as the task does."""
    total = 0.0
    if not steps:  # nobody decided: what ended it counts nevertheless
        reward = definition.reward
        total += {"collision": reward.collision, "no_progress": reward.no_progress}.get(summary.outcome, 0.0)
    for step in steps:
        total += step.reward or 0.0
    return total


def _moves(definition: Definition, steps: Sequence[JournalStep], summary: EpisodeSummary) -> Iterator[Trouble]:
    limits = definition.limits
    least = limits.move_limit if summary.outcome == "move_limit" else steps[-1].step + 1 if steps else 0
    if not least <= summary.moves <= limits.move_limit:
        yield Trouble("moves", f"{least} to {limits.move_limit}", str(summary.moves))
    aside = _without_progress(steps, summary.moves)
    if summary.outcome == "no_progress" and not 0 < limits.no_progress_moves < aside:
        expected = f"another outcome after {aside} moves without progress, limit {limits.no_progress_moves}"
        yield Trouble("outcome", expected, summary.outcome)


def _without_progress(steps: Sequence[JournalStep], moves: int) -> int:
    """Return how many decisions at the end of an episode followed each other without one in +Z."""
    count = 0
    for step in reversed(steps):
        if step.action == INSERT or step.step + 1 != moves - count:
            break
        count += 1
    return count


def _magnitudes(definition: Definition, steps: Sequence[JournalStep], summary: EpisodeSummary) -> Iterator[Trouble]:
    """Hold means and peaks against the magnitudes that are known: those felt before each decision but at home."""
    felt = [step for step in steps if step.step > 0]
    forces_n = [math.hypot(*step.force_n) for step in felt]
    torques_nm = [math.hypot(*step.torque_nm) for step in felt]
    collision_n = definition.limits.collision_force_n
    if summary.moves > 0 and (summary.outcome == "collision") != (summary.peak_force_n >= collision_n):
        expected = "at least" if summary.outcome == "collision" else "below"
        yield Trouble("peak_force_n", f"{expected} {collision_n:g} N ({summary.outcome})", repr(summary.peak_force_n))
    rows = (
        ("force_n", forces_n, summary.mean_force_n, summary.peak_force_n),
        ("torque_nm", torques_nm, summary.mean_torque_nm, summary.peak_torque_nm),
    )
    for unit, known, mean, peak in rows:
        if peak < max(known, default=0.0):
            yield Trouble(f"peak_{unit}", f"at least {max(known)!r}", repr(peak))
        moves, least = max(summary.moves, 1), math.fsum(known)
        most = least + max(summary.moves - len(known), 0) * peak
        if not (least / moves) * (1 - _ROUNDING) <= mean <= (most / moves) * (1 + _ROUNDING):
            yield Trouble(f"mean_{unit}", f"{least / moves!r} to {most / moves!r}", repr(mean))
