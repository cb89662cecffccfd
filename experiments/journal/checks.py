"""What of an episode in the journal can be checked without physics and without a worker's memory. Pure.

The journal has no motion between two decisions and no force after the last one, so rewards and summary are held against
what is known: exactly where that decides, as a bound where it does not.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from experiments.journal.magnitudes import Trouble, magnitude_troubles
from services.task.rewards import Potential, cost_of_force, end_reward, reward_of_move
from services.wire.actions import guidance, increments
from services.wire.definition import Definition, InsertionReward
from services.wire.felt_noise import contact_force_n
from services.wire.messages import EpisodeSummary, JournalStep

_SAME_MM = 1e-9
_DECIMALS = range(2, 10)
"""A robot may make moves that are rounded to so many decimals."""


def reward_trouble(
    definition: Definition, steps: Sequence[JournalStep], index: int, summary: EpisodeSummary
) -> Trouble | None:
    """Return what is wrong with the reward of a step of a finished episode, given the definition's reward function."""
    step = steps[index]
    allowed = _rewards(definition, steps, index, summary)
    unknown, got = _unknown_cost(definition, steps, index, summary), step.reward
    if got is not None and any(most - unknown <= got <= most for most in allowed):
        return None
    expected = " or ".join(repr(value) for value in sorted(allowed))
    return Trouble("reward", expected + (f", less by at most {unknown:g}" if unknown else ""), repr(got))


def step_troubles(definition: Definition, steps: Sequence[JournalStep], index: int) -> Iterator[Trouble]:
    """Give what is wrong with the place and the force of a step."""
    step, limits = steps[index], definition.limits
    least = steps[index - 1].step + 1 if index else 0
    if step.step < least:
        yield Trouble("step", f"{least} or more", str(step.step))
    force_n = math.hypot(*step.force_n)
    contact_n = contact_force_n(definition)
    if not contact_n <= force_n < limits.collision_force_n:
        expected = f"a force from {contact_n:g} to below {limits.collision_force_n:g} N"
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
    potential, after, cost = Potential(definition), 0.0, 0.0
    if not last:
        then = steps[index + 1]
        after = potential.of(then.force_n, then.torque_nm)
        if _at_once(steps, index, summary):
            cost = cost_of_force(reward, math.hypot(*then.force_n))
    price = potential.price(_led_mm(definition, step), potential.of(step.force_n, step.torque_nm), after)
    earned = _moves_rewards(definition, steps, index, summary)
    return frozenset((end_reward(reward, summary.outcome, value) if last else value - cost) + price for value in earned)


def _led_mm(definition: Definition, step: JournalStep) -> float:
    """Return how far in +Z a decision was to lead."""
    return increments(definition.moves)[step.action or 0].dz_mm


def _at_once(steps: Sequence[JournalStep], index: int, summary: EpisodeSummary) -> bool:
    """Return whether nothing was moved between a step's move and the next decision, or the episode's end."""
    then = summary.moves if index == len(steps) - 1 else steps[index + 1].step
    return then <= steps[index].step + 1


def _unknown_cost(definition: Definition, steps: Sequence[JournalStep], index: int, summary: EpisodeSummary) -> float:
    """Return what a step's force may have cost that the journal does not tell: contact was lost, guidance went on."""
    ended = index == len(steps) - 1 and summary.outcome in ("collision", "no_progress")
    if ended or _at_once(steps, index, summary):
        return 0.0
    return cost_of_force(definition.reward, contact_force_n(definition))


def _moves_rewards(
    definition: Definition, steps: Sequence[JournalStep], index: int, summary: EpisodeSummary
) -> frozenset[float]:
    """Return what a step's move may have earned, had it not ended the episode."""
    reward, step = definition.reward, steps[index]
    last, dz_mm = index == len(steps) - 1, _led_mm(definition, step)
    if isinstance(reward, InsertionReward) or dz_mm < 0.0:
        return frozenset({reward_of_move(reward, dz_mm, 1.0, 1.0)})
    before_n, contact_n = math.hypot(*step.force_n), contact_force_n(definition)
    if not _at_once(steps, index, summary):
        after_n = [0.0, math.nextafter(contact_n, 0.0)]  # guidance went on: the force had fallen below contact
    elif last:
        return frozenset({reward.fell, reward.rose, reward.otherwise})
    else:
        after_n = [math.hypot(*steps[index + 1].force_n)]
    return frozenset(reward_of_move(reward, dz_mm, before_n, force_n) for force_n in after_n)


def _return(definition: Definition, steps: Sequence[JournalStep], summary: EpisodeSummary) -> float:
    """Return the sum of the rewards, added in their order as the task does."""
    total = 0.0
    if not steps:  # nobody decided: what ended it counts nevertheless
        total += end_reward(definition.reward, summary.outcome, 0.0)
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
    rows = _without_progress(definition, steps)
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


def _told_mm(definition: Definition, steps: Sequence[JournalStep], moves: int) -> list[tuple[float, bool]]:
    """Return how far each motion was told to lead along Z [mm], and whether the task told it and no decision."""
    forward_mm, moved_mm = guidance(definition.moves).dz_mm, [motion.dz_mm for motion in increments(definition.moves)]
    told: list[tuple[float, bool]] = []
    for step in steps:
        told += [(forward_mm, True)] * (step.step - len(told))
        told.append((moved_mm[step.action or 0] if step.increment is None else step.increment[2], False))
    return told + [(forward_mm, True)] * (moves - len(told))


def _without_progress(definition: Definition, steps: Sequence[JournalStep]) -> list[int]:
    """Return how many decisions up to each followed each other without leading deeper than the episode was before.

    Guidance between two decisions is progress too where it leads deeper.
    """
    rows: list[int] = []
    depth_mm = deepest_mm = -definition.start.height_mm
    idle = 0
    decided = iter(steps)
    for dz_mm, guided in _told_mm(definition, steps, 0):
        depth_mm += dz_mm
        # A move that is no listed one is progress only if it counts as one in +Z.
        forward = guided or _led_mm(definition, next(decided)) > 0.0
        deeper = forward and depth_mm > deepest_mm + _SAME_MM
        deepest_mm = max(deepest_mm, depth_mm)
        idle = 0 if deeper else idle + (not guided)
        if not guided:
            rows.append(idle)
    return rows


def _depth(definition: Definition, steps: Sequence[JournalStep], summary: EpisodeSummary) -> Iterator[Trouble]:
    """Hold the outcome against how far the arm was told to go in +Z: each move is guidance or a decision's."""
    told_mm = [dz_mm for dz_mm, _ in _told_mm(definition, steps, summary.moves)]
    wanted_mm = definition.limits.success_fraction * definition.parts.peg_height_mm
    depths_mm, before_mm = _depths_mm(definition, told_mm), _depths_mm(definition, told_mm[:-1])
    place = f"at {depths_mm[0]:g} mm, success at {wanted_mm:g} mm"
    if summary.outcome == "inserted" and depths_mm[-1] < wanted_mm:
        yield Trouble("outcome", f"another {place}", summary.outcome)
    if summary.outcome in ("no_progress", "move_limit") and depths_mm[0] >= wanted_mm:
        yield Trouble("outcome", f"inserted {place}", summary.outcome)
    if before_mm[0] >= wanted_mm:
        yield Trouble("moves", f"an end before the last move {place}", str(summary.moves))


def _depths_mm(definition: Definition, told_mm: Sequence[float]) -> list[float]:
    """Return how far below the mouth these steps along Z may bring the tip, in order, each added as the task does."""
    roundings: list[Callable[[float], float]] = [float, *(partial(round, ndigits=decimals) for decimals in _DECIMALS)]
    start_mm = -definition.start.height_mm
    return sorted({functools.reduce(operator.add, map(made, told_mm), start_mm) for made in roundings})
