"""A skill for a task with other moves: what was learnt of the moves that both have is kept, the rest is unknown. Pure.

A move of the one is a move of the other when it has the same name and goes the same way; how far it goes may differ.
What is thought of it stays what it was, since forces tell which way to go and hardly how far; what that is worth is for
the new task to find out (docs/experiments/claims.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from services.rules.skill import NamedSkill, SkillError, named
from services.rules.skill_memory import Memory, number
from services.rules.swaps import in_force
from services.wire.actions import Increment, action_names, increments, lines
from services.wire.definition import Definition, FeltModel, Moves, Plugin
from services.wire.definition_file import definition_sha256, run_id
from services.wire.definition_rules import contradiction
from services.wire.text import one_line

_SAME = 1e-9
"""Distance between unit vectors up to which two directions are one."""
_LONGEST_SOURCE = 500

Floats = NDArray[np.float64]


class Carried(NamedTuple):
    """A skill for other moves, and what became of each move."""

    skill: NamedSkill
    kept: tuple[str, ...]
    """Moves that both have, in the new task's order; with their sizes where these differ."""
    unknown: tuple[str, ...]
    """Moves that were never learnt: the new task's others."""
    left_out: tuple[str, ...]
    """Moves that the new task has not."""

    @property
    def text(self) -> str:
        """What became of the moves, in words."""
        return "; ".join(
            f"{what} {' '.join(names) or 'none'}"
            for what, names in (("kept", self.kept), ("unknown", self.unknown), ("left out", self.left_out))
        )


def carried(skill: NamedSkill, definition: Definition) -> Carried:
    """Return a skill for the moves of a definition; the same bytes whenever and wherever it is done.

    Its definition is that of the skill with the other moves, and says in ``source`` where it comes from; it began with
    the skill that was carried over (``skill_sha256``). Raises SkillError when no move is kept, when a plug-in's memory
    would have to be taken apart, or when the parts of the skill do not allow these moves.
    """
    inside = skill.skill
    learnt = in_force(inside.definition, inside.swaps)
    if isinstance(learnt.learner, Plugin):
        raise SkillError(
            f"skill: expected a learner whose memory is known by moves, got the plug-in {learnt.learner.name}"
        )
    before, after = inside.definition.moves, definition.moves
    places = _places(before, after)
    if all(place is None for place in places):
        theirs, ours = ", ".join(action_names(before)), ", ".join(action_names(after))
        raise SkillError(f"skill: expected a move of {definition.name} that it has learnt ({theirs}), got {ours}")
    agent = _table(inside.agent, places)
    if isinstance(learnt.learner, FeltModel):
        agent |= _model(inside.agent, before, after, places, learnt.learner.ridge)
    made = replace(inside.definition, moves=after)
    told = Carried(skill, *_told(before, after, places))
    came = f"skill {skill.sha256[:12]} of {inside.definition.name}, with the moves of {definition.name}: {told.text}"
    made = replace(made, source=one_line(came, _LONGEST_SOURCE))
    if conflict := contradiction(made):
        raise SkillError(f"skill: with the moves of {definition.name}: {conflict[0]}: {conflict[1]}")
    return told._replace(
        skill=named(
            replace(
                inside,
                definition=made,
                definition_sha256=definition_sha256(made),
                run=run_id(made, inside.seed, skill.sha256),
                skill_sha256=skill.sha256,
                actions=action_names(after),
                agent=agent,
            )
        )
    )


def _places(before: Moves, after: Moves) -> list[int | None]:
    """Return for each move of ``after`` which move of ``before`` it is, None where it is none."""
    there = {name: index for index, name in enumerate(action_names(before))}
    steps = increments(before)
    return [
        index if (index := there.get(name)) is not None and _one_way(steps[index], step) else None
        for name, step in zip(action_names(after), increments(after), strict=True)
    ]


def _one_way(one: Increment, other: Increment) -> bool:
    """Return whether two increments, neither of them nothing, have the same direction."""
    lengths = math.hypot(*one), math.hypot(*other)
    return math.dist([value / lengths[0] for value in one], [value / lengths[1] for value in other]) < _SAME


def _told(
    before: Moves, after: Moves, places: list[int | None]
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Return in words which moves are kept, unknown and left out."""
    names, steps, sizes = action_names(after), increments(before), increments(after)
    kept, unknown = list[str](), list[str]()
    for name, size, place in zip(names, sizes, places, strict=True):
        if place is None:
            unknown.append(name)
            continue
        was, now = math.hypot(*steps[place]), math.hypot(*size)
        kept.append(name if was == now else f"{name} ({was:g} to {now:g})")
    left_out = tuple(name for index, name in enumerate(action_names(before)) if index not in places)
    return tuple(kept), tuple(unknown), left_out


def _table(memory: Memory, places: list[int | None]) -> dict[str, bytes | int]:
    """Return a table with a column for each new move: that of the move it is, or zeros without a visit."""
    states, actions = number(memory, "states"), number(memory, "actions")
    q = np.frombuffer(_bytes(memory, "q"), "<f8").reshape(states, actions)
    visits = np.frombuffer(_bytes(memory, "visits"), "<i8").reshape(states, actions)
    new_q, new_visits = np.zeros((states, len(places)), "<f8"), np.zeros((states, len(places)), "<i8")
    for column, place in enumerate(places):
        if place is not None:
            new_q[:, column], new_visits[:, column] = q[:, place], visits[:, place]
    # A table ends with the last state that anything was learnt in.
    visited = np.flatnonzero(new_visits.any(axis=1))
    rows = int(visited[-1]) + 1 if visited.size else 0
    return {
        "actions": len(places),
        "states": rows,
        "version": int(new_visits.sum()),
        "q": new_q[:rows].tobytes(),
        "visits": new_visits[:rows].tobytes(),
    }


def _model(
    memory: Memory, before: Moves, after: Moves, places: list[int | None], ridge: float
) -> dict[str, bytes | int]:
    """Return the model of what is felt, a line of motion for each of the new moves; an unknown one is as at first."""
    features = number(memory, "features")
    theta = np.frombuffer(_bytes(memory, "theta"), "<f8").reshape(-1, features)
    halves = np.frombuffer(_bytes(memory, "covariances"), "<f8").reshape(len(theta), -1)
    (old_lines, old_sizes), (new_lines, new_sizes) = lines(before), lines(after)
    count = 1 + max(new_lines)
    first = np.zeros(halves.shape[1])
    first[np.cumsum([0, *range(features, 1, -1)])] = 1.0 / ridge
    new_theta, new_halves = np.zeros((count, features)), np.tile(first, (count, 1))
    for line, (move, place) in _largest(new_lines, new_sizes, places).items():
        # Sizes are parts of the line's largest: what is thought of this move is to stay what it was.
        factor = old_sizes[place] / new_sizes[move]
        new_theta[line] = factor * theta[old_lines[place]]
        new_halves[line] = factor * factor * halves[old_lines[place]]
    return {
        "lines": count,
        "features": features,
        "theta": new_theta.astype("<f8").tobytes(),
        "covariances": new_halves.astype("<f8").tobytes(),
    }


def _largest(
    new_lines: tuple[int, ...], new_sizes: tuple[float, ...], places: list[int | None]
) -> Mapping[int, tuple[int, int]]:
    """Return of each line that has a kept move the largest of these, and which one that was."""
    chosen: dict[int, tuple[int, int]] = {}
    for move, (line, place) in enumerate(zip(new_lines, places, strict=True)):
        if place is not None and (line not in chosen or abs(new_sizes[move]) > abs(new_sizes[chosen[line][0]])):
            chosen[line] = (move, place)
    return chosen


def _bytes(memory: Memory, name: str) -> bytes:
    value = memory[name]
    assert isinstance(value, bytes)  # a skill that has been read is sound
    return value
