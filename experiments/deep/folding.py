"""What the curves come to: figures, points, and from when on a learner is as good as the rule. Pure."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypedDict

from experiments.deep.jobs import Learnt
from experiments.evaluate.figures import wilson
from experiments.leaderboard.figures import INSERTED, Figures, figures, ratio
from experiments.leaderboard.jobs import Outcome

BLOCK = 10
"""Episodes in a point of a curve."""
WINDOW = 20
"""Episodes in a row that tell whether a learner has become as good as somebody else."""


class Curve(TypedDict):
    """One seed, a point for every ``BLOCK`` episodes."""

    failures: list[float]
    """Part that was not inserted."""
    force_n: list[float]
    """Mean force."""


class Frozen(TypedDict):
    """Episodes after learning, best known actions only, all seeds pooled."""

    trials: int
    successes: int
    success_low: float
    success_high: float
    force_n: float


class Row(TypedDict):
    """One method on one task, as in ``deep.json``."""

    task: str
    method: str
    figures: Figures
    force_of_rule: float | None
    moves_of_rule: float | None
    as_sure_after: list[int | None]
    """Episodes before the first ``WINDOW`` in which a seed inserts as often as the rule; None: never."""
    as_good_after: list[int | None]
    """The same, pressing no more than the rule as well."""
    decisions: list[int] | None
    """That each seed learnt from; None for who does not learn by itself here."""
    frozen: Frozen | None
    curves: list[Curve]


class Rule(NamedTuple):
    """What a learner is held against."""

    success: float
    force_n: float


def curve(outcome: Outcome) -> Curve:
    """Return the points of a run; a last block that is not full counts as far as it goes."""
    blocks = [slice(begin, begin + BLOCK) for begin in range(0, len(outcome.outcomes), BLOCK)]
    return {
        "failures": [failed(outcome.outcomes[block]) for block in blocks],
        "force_n": [statistics.fmean(outcome.force_n[block]) for block in blocks],
    }


def failed(letters: str) -> float:
    """Return the part of some episodes, at least one, that was not inserted."""
    return 1.0 - letters.count(INSERTED) / len(letters)


def as_good(outcome: Outcome, success: float, force_n: float = math.inf) -> int | None:
    """Return how many episodes are over before the first ``WINDOW`` in a row that are as good; None: there are none.

    As good is at least that success and at most that mean force [N].
    """
    for begin in range(len(outcome.outcomes) - WINDOW + 1):
        window = slice(begin, begin + WINDOW)
        if 1.0 - failed(outcome.outcomes[window]) >= success and statistics.fmean(outcome.force_n[window]) <= force_n:
            return begin
    return None


def rule_of(made: Figures | None) -> Rule | None:
    """Return what the rule's figures ask of others: its success and its mean force."""
    return None if made is None else Rule(made["success"], made["force_n"]["mean"])


def row(
    task: str,
    method: str,
    outcomes: Mapping[int, Outcome],
    rule: Figures | None,
    learns: bool,
    learnt: Mapping[int, Learnt] | None = None,
) -> Row:
    """Return the row of a method from its seeds' outcomes, each as long as the others; at least one.

    ``learnt`` has what is known of deep learners beside.
    """
    seeds, of = sorted(outcomes), figures(outcomes, learns)
    parts, wanted = None if rule is None else ratio(of, rule), rule_of(rule)
    whole = [outcomes[seed] for seed in seeds]
    return {
        "task": task,
        "method": method,
        "figures": of,
        "force_of_rule": None if parts is None else parts.force,
        "moves_of_rule": None if parts is None else parts.moves,
        "as_sure_after": [] if wanted is None else [as_good(one, wanted.success) for one in whole],
        "as_good_after": [] if wanted is None else [as_good(one, wanted.success, wanted.force_n) for one in whole],
        "decisions": None if learnt is None else [learnt[seed].decisions for seed in seeds],
        "frozen": None if learnt is None else frozen([learnt[seed].frozen for seed in seeds]),
        "curves": [curve(one) for one in whole],
    }


def frozen(outcomes: Sequence[Outcome]) -> Frozen:
    """Return what a method does that learns no more."""
    letters = "".join(outcome.outcomes for outcome in outcomes)
    successes = letters.count(INSERTED)
    low, high = wilson(successes, len(letters))
    return {
        "trials": len(letters),
        "successes": successes,
        "success_low": low,
        "success_high": high,
        "force_n": statistics.fmean([force for outcome in outcomes for force in outcome.force_n]),
    }
