"""Evaluations over several seeds and cores: methods on one task, on the same starts and with the same noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from experiments.evaluate.controllers import (
    PUSH,
    RANDOM,
    SPIRAL,
    TIP_RULE,
    ComplianceRule,
    Controller,
    Push,
    RandomMoves,
    SpiralRule,
    TipRule,
)
from experiments.evaluate.figures import Figures, figures
from experiments.evaluate.frozen import FrozenSkill
from experiments.evaluate.trial import Trial, trial
from experiments.lab import pool
from services.rules.skill import NamedSkill
from services.wire.definition import Definition


class Method(NamedTuple):
    """What decides: a learnt skill, or one of ``BASELINES`` by its name."""

    name: str
    skill: NamedSkill | None = None

    def controller(self, definition: Definition, seed: int) -> Controller:
        """Return the controller of one seed. Raises SkillError when a skill does not fit the task."""
        if self.skill is not None:
            return FrozenSkill(self.skill, definition, seed)
        if self.name == RANDOM:
            return RandomMoves(definition, seed)
        if self.name == PUSH:
            return Push()
        if self.name == SPIRAL:
            return SpiralRule(definition)
        return TipRule(definition) if self.name == TIP_RULE else ComplianceRule(definition)


class Piece(NamedTuple):
    """Episodes of one method and seed."""

    definition: Definition
    method: Method
    seed: int
    episodes: int


def evaluate(
    definition: Definition,
    methods: Sequence[Method],
    seeds: Sequence[int],
    episodes: int,
    moves_per_s: float,
    jobs: int,
    advanced: Callable[[int, int], None] = lambda _index, _count: None,
) -> dict[str, Figures]:
    """Return the figures of each method by its name.

    ``advanced`` hears how many episodes of which piece are done, pieces being counted method by method. Raises
    PieceError when one fails, KeyboardInterrupt upon Ctrl-C.
    """
    pieces = [Piece(definition, method, seed, episodes) for method in methods for seed in seeds]
    trials: dict[int, Trial] = dict(pool.spread(_work, pieces, jobs, _name, advanced))
    count = len(seeds)
    by_method = [[trials[place * count + offset] for offset in range(count)] for place in range(len(methods))]
    return {
        method.name: figures(its_trials, moves_per_s) for method, its_trials in zip(methods, by_method, strict=True)
    }


def _work(piece: Piece, tell: pool.Tell) -> Trial:
    controller = piece.method.controller(piece.definition, piece.seed)
    return trial(piece.definition, controller, piece.seed, piece.episodes, tell)


def _name(piece: Piece) -> str:
    return f"{piece.method.name}, seed {piece.seed}"
