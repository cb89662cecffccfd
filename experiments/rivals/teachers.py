"""Who teaches the supervised rivals, and what they are shown: insertions with a move for each load that is felt.

Two teachers. The rule answers what is felt, as an engineer wrote it. The operator sees the true pose of peg and hole,
tries every move in a simulation of its own and makes the one that leaves least force and least to do: the oracle's
search (``experiments.oracle``), looking one move ahead, without noise.

A pupil that only saw good insertions would never have seen what its own mistakes lead to. So the teacher's hand is
pushed at times: a move that is drawn is made, and the pupil is told what the teacher would have done.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

from experiments.evaluate.controllers import Controller
from experiments.lab.guided import make, told
from experiments.oracle.search import Explorer, corridor_moves
from services.sim.cell import SimulatedCell
from services.sim.geometry import geometry_of
from services.task.insertion import Insertion
from services.wire.actions import INSERT, increments
from services.wire.definition import Definition
from services.wire.definition_file import run_id
from services.wire.messages import EpisodeSummary, Home, Move, Observation
from services.wire.randomness import Role, generator

SEEDS_APART = 10**9
"""Added to a run's seed for what it is taught with: no start and no noise is seen twice."""
ASTRAY = 0.3
"""Part of the decisions where a move is drawn in place of the teacher's."""
FORCE_MOVES_PER_N = 3.0
"""How many moves a newton is worth to the operator."""
LEAN_N = 1.0
"""What may stand on the wrist: walls nearer than this bends it need no move."""


class Shown(NamedTuple):
    """One lesson: what was felt, and what the teacher would do about it."""

    felt: Observation
    action: int


class Teacher(Protocol):
    """Says what to do; one that sees may look at the world."""

    def __call__(self, felt: Observation, world: Explorer) -> int:
        """Return the move to make."""


def by_rule(rule: Controller) -> Teacher:
    """Return a teacher that follows a hand-written rule and sees nothing."""
    return lambda felt, _world: rule.decide(felt).action


class Operator:
    """Sees everything, and looks one move ahead."""

    def __init__(self, definition: Definition) -> None:
        self._definition = definition
        self._geometry = geometry_of(definition.parts)
        self._increments = increments(definition.moves)
        self._success_mm = definition.limits.success_fraction * definition.parts.peg_height_mm
        self._lean_mm = LEAN_N / definition.wrist.stiffness_n_per_mm
        self._world = Explorer(definition)

    def __call__(self, felt: Observation, world: Explorer) -> int:
        """Return the move that leaves least; of equals the first, +Z before all."""
        stands = world.snapshot()
        costs = []
        for action, increment in enumerate(self._increments):
            self._world.resume(stands)
            force_n = math.hypot(*self._world.move(increment).force_n)
            own = 0.0 if action == INSERT else 1.0
            costs.append((own + FORCE_MOVES_PER_N * force_n + self._to_go(), action != INSERT, action))
        return min(costs)[2]

    def _to_go(self) -> float:
        """Return how many moves would still be needed from where the world stands."""
        ways = corridor_moves(self._geometry, self._world.flange, self._success_mm, self._definition)
        return min(turns + max(0.0, overlap_mm - self._lean_mm) * per_mm for turns, overlap_mm, per_mm in ways)


def show(
    definition: Definition, teacher: Teacher, seed: int, insertions: int, begin: Callable[[], None] = lambda: None
) -> list[Shown]:
    """Return the lessons of so many insertions; ``begin`` is called before each."""
    own = seed + SEEDS_APART
    run, world = run_id(definition, own), Explorer(definition)
    cell, task = SimulatedCell(definition, run, own, world), Insertion(definition, run, own)
    lessons: list[Shown] = []
    for episode in range(insertions):
        begin()
        motion: Home | Move = task.home(episode, len(lessons))
        while True:
            then = make(task, cell, motion).then
            if isinstance(then, EpisodeSummary):
                break
            action = teacher(then, world)
            lessons.append(Shown(then, action))
            draws = generator(own, Role.POLICY, episode, then.step)
            if draws.random() < ASTRAY:
                action = int(draws.integers(definition.moves.count))
            motion = task.act(told(then, action))
    return lessons
