"""Runs of definitions that are shipped ones with something changed, and what else is asked of them.

Beside returns, forces and outcomes: where an episode that made no progress was stuck, and how far from the hole's axis
the peg's tip was when an episode ended, which only the simulator knows.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import TypeVar

from experiments.lab.in_process import InProcessRun
from experiments.reproduce.context import Context
from experiments.reproduce.insertion_runs import LETTERS, Gone
from services.wire.actions import action_names
from services.wire.definition import Definition
from services.wire.definition_file import definition_sha256

C = TypeVar("C")
Wanted = tuple[Definition, int, int]
"""Definition, seed and number of episodes of a run."""
LOOP = 20
"""Decisions at the end of an episode that have to alternate between two moves, so that it counts as a loop."""
LATE = 100
"""Decisions at the end of an episode among which rotations about Z are counted."""


@dataclass(frozen=True)
class Variant:
    """What a run depends on."""

    definition_sha256: str
    seed: int
    episodes: int
    version: int = 1


@dataclass(frozen=True)
class Stuck:
    """How an episode ended that made no progress, or too many moves."""

    episode: int
    loop: str
    """The two moves that it alternated between to the end, such as ``+RZ -RZ``; empty when it did not."""
    states: str
    """The contact states in which these two were made, such as ``3 0``; of several, the commonest."""
    rz_part: float
    """Part of its last 100 decisions that turned about Z."""


@dataclass(frozen=True)
class Tried:
    """How a run went: one entry an episode."""

    gone: Gone
    away_mm: list[float]
    """How far from the hole's axis the tip was at the end."""
    stuck: list[Stuck] = field(default_factory=list)


def tried(context: Context, wanted: Sequence[Wanted]) -> list[Tried | None]:
    """Return what came of runs, in their order; None for one that is not there and not to be made now."""
    definitions = {definition_sha256(definition): definition for definition, _, _ in wanted}
    keys = [Variant(definition_sha256(definition), seed, episodes) for definition, seed, episodes in wanted]
    return context.pieces_kept("insertions, varied", keys, partial(attempt, definitions), Tried)


def by_condition(conditions: Sequence[C], seeds: int, done: Sequence[Tried | None]) -> dict[C, list[Tried]]:
    """Return the runs there are of each condition; ``done`` has all conditions of a seed and then the next."""
    return {
        condition: [run for seed in range(seeds) if (run := done[seed * len(conditions) + number]) is not None]
        for number, condition in enumerate(conditions)
    }


def attempt(definitions: Mapping[str, Definition], variant: Variant) -> Tried:
    """Make a run; ``definitions`` has them by hash."""
    definition = definitions[variant.definition_sha256]
    names = action_names(definition.moves)
    run = InProcessRun(definition, variant.seed)
    gone, away_mm, stuck = Gone([], [], [], "", 0), list[float](), list[Stuck]()
    letters = list[str]()
    for summary in run.episodes(variant.episodes):
        gone.returns.append(summary.episode_return)
        gone.force_n.append(summary.mean_force_n)
        gone.torque_nm.append(summary.mean_torque_nm)
        letters.append(LETTERS[summary.outcome])
        peg = run.cell.world.peg
        away_mm.append(math.hypot(peg.x_mm, peg.y_mm))
        if letters[-1] in "pm":
            steps = [step for step in run.task.record().steps if step.action is not None]
            moves = [names[step.action or 0] for step in steps]
            stuck.append(ending(summary.episode, moves, [step.state for step in steps]))
    whole = Gone(gone.returns, gone.force_n, gone.torque_nm, "".join(letters), summary.states)
    return Tried(whole, away_mm, stuck)


def ending(episode: int, moves: Sequence[str], states: Sequence[int | None]) -> Stuck:
    """Return how an episode ended whose decisions were these moves in these contact states."""
    late = moves[-LATE:]
    rz_part = sum(move.endswith("RZ") for move in late) / max(1, len(late))
    last = moves[-LOOP:]
    pair = sorted(set(last))
    alternates = len(last) == LOOP and len(pair) == 2 and all(a != b for a, b in pairwise(last))
    if not alternates:
        return Stuck(episode, "", "", rz_part)
    commonest = [
        str(
            Counter(state for move, state in zip(last, states[-LOOP:], strict=True) if move == one).most_common(1)[0][0]
        )
        for one in pair
    ]
    return Stuck(episode, " ".join(pair), " ".join(commonest), rz_part)
