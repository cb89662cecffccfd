"""What of an episode in the journal can be checked without physics and without a worker's memory. Pure.

The journal has no motion between two decisions and no force after the last one, so rewards and summary are held against
what is known: exactly where that decides, as a bound where it does not.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Iterator, Sequence

from experiments.journal.magnitudes import Trouble, magnitude_troubles
from services.task.rewards import reward_of_move
from services.wire.actions import INSERT
from services.wire.definition import Definition, InsertionReward
from services.wire.messages import EpisodeSummary, JournalStep

_DECIMALS = range(2, 10)
"""A robot may make moves that are rounded to so many decimals."""


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
    yield from _outcome(definition, steps, summary)
    yield from magnitude_troubles(definition, steps, summary)


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


def _outcome(definition: Definition, steps: Sequence[JournalStep], summary: EpisodeSummary) -> Iterator[Trouble]:
    """Hold an outcome against how the episode ended, and what came before against an earlier end."""
    limits, outcome, moves = definition.limits, summary.outcome, summary.moves
    if moves == 0 and outcome != "collision":
        yield Trouble("outcome", "collision, as there was no move", outcome)
    rows = _without_progress(steps)
    aside = rows[-1] if steps and steps[-1].step + 1 == moves else 0
    too_many = 0 < limits.no_progress_moves < aside
    if too_many != (outcome == "no_progress") and not (too_many and outcome in ("collision", "inserted")):
        expected = "another outcome" if outcome == "no_progress" else "no_progress"
        expected += f" after {aside} moves without progress, limit {limits.no_progress_moves}"
        yield Trouble("outcome", expected, outcome)
    for step, row in zip(steps[:-1], rows, strict=False):
        if 0 < limits.no_progress_moves < row:
            expected = f"no decision after {row} moves without progress, limit {limits.no_progress_moves}"
            yield Trouble("decisions", expected, f"more after step {step.step}")
            break
    yield from _depth(definition, steps, summary)


def _without_progress(steps: Sequence[JournalStep]) -> list[int]:
    """Return how many decisions up to each followed each other without one in +Z and without guidance."""
    rows: list[int] = []
    for index, step in enumerate(steps):
        follows = index > 0 and step.step == steps[index - 1].step + 1
        rows.append(0 if step.action == INSERT else 1 + (rows[-1] if follows else 0))
    return rows


def _depth(definition: Definition, steps: Sequence[JournalStep], summary: EpisodeSummary) -> Iterator[Trouble]:
    """Hold the outcome against how far the arm was told to go in +Z: each move is guidance or a decision's."""
    told = max(0, summary.moves - len(steps)) + sum(step.action == INSERT for step in steps)
    by_guidance = not steps or summary.moves > steps[-1].step + 1
    told_before = told - (1 if by_guidance or steps[-1].action == INSERT else 0)
    wanted_mm = definition.limits.success_fraction * definition.parts.peg_height_mm
    depths_mm, before_mm = _depths_mm(definition, told), _depths_mm(definition, told_before)
    place = f"at {depths_mm[0]:g} mm, success at {wanted_mm:g} mm"
    if summary.outcome == "inserted" and depths_mm[-1] < wanted_mm:
        yield Trouble("outcome", f"another {place}", summary.outcome)
    if summary.outcome in ("no_progress", "move_limit") and depths_mm[0] >= wanted_mm:
        yield Trouble("outcome", f"inserted {place}", summary.outcome)
    if before_mm[0] >= wanted_mm:
        yield Trouble("moves", f"an end before the last move {place}", str(summary.moves))


def _depths_mm(definition: Definition, told: int) -> list[float]:
    """Return how far below the mouth so many moves in +Z may bring the tip, in order, each added as the task does."""
    asked_mm = definition.moves.insertion_mm
    made_mm = {asked_mm, *(round(asked_mm, decimals) for decimals in _DECIMALS)}
    return sorted(functools.reduce(operator.add, [one] * told, -definition.start.height_mm) for one in made_mm)
