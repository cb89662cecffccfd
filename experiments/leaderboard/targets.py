"""What the learner shall reach on each task, beside what it reached: one row a group of tasks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from fnmatch import fnmatchcase
from typing import NamedTuple

from experiments.leaderboard.figures import Figures, ratio


class Target(NamedTuple):
    """What is aimed at; None where nothing is."""

    tasks: tuple[str, ...]
    """Shell-style patterns of names."""
    first_median: float | None = None
    """Failures in the first 20 episodes, median over the seeds."""
    first_most: int | None = None
    success: float | None = None
    """Of the last episodes, all seeds pooled."""
    above_rule: bool = False
    """Success shall be above the hand-written rule's, or all there is."""
    force_of_rule: float | None = None
    """Mean force as a part of the rule's."""
    moves_of_rule: float | None = None
    force_n: float | None = None
    force_as: str | None = None
    """Mean force as on this task, within the spread over its seeds."""
    steady_median: int | None = None
    """Episodes until a run is steady."""
    steady_all: int | None = None


TARGETS = (
    Target(("suite-round", "suite-round-tight"), 0, 1, 0.999, force_of_rule=0.5, moves_of_rule=0.92),
    Target(("suite-turned",), 0, 1, 0.999, force_as="suite-round"),
    Target(("suite-turned-tight",), 0, 1, 0.999, force_as="suite-round-tight"),
    Target(("suite-turned-square",), 0, 2, 0.998, force_as="suite-square"),
    Target(
        ("suite-square*", "suite-triangle*", "suite-rectangle*"), 0, 2, 0.998, force_of_rule=0.65, moves_of_rule=0.98
    ),
    Target(("suite-round-fine",), 2, 5, 0.99, force_of_rule=0.8),
    Target(("suite-industreal-*",), 1, 4, 0.995, above_rule=True, force_of_rule=0.9),
    Target(("suite-stiff-wrist",), 2, 4, 0.998, force_n=0.35),
    Target(("suite-noisy",), 2, 4, 0.998, force_n=1.2),
    Target(("suite-rubber",), 0, 1, 0.998, force_n=0.6),
    Target(
        ("suite-chamferless-start", "suite-chamferless-fixed"),
        None,
        None,
        0.99,
        force_n=0.6,
        steady_median=60,
        steady_all=150,
    ),
    Target(("suite-chamferless",), success=0.95),
)
EASILY = 0.75
"""A target on force or moves is easily beaten where what was reached is below this part of it."""


class Verdict(NamedTuple):
    """Whether a target was reached, and in words where it was missed or easily beaten."""

    met: bool
    words: str


def target_of(task: str) -> Target | None:
    """Return the target of a task, None for one without."""
    return next((target for target in TARGETS if any(fnmatchcase(task, name) for name in target.tasks)), None)


def verdict(target: Target, ours: Figures, rule: Figures | None, others: Mapping[str, Figures]) -> Verdict:
    """Hold figures against a target; ``others`` are the same method's on other tasks, by their name."""
    misses, easy = list[str](), list[str]()
    for words, reached, aim, below in _figures(target, ours, rule, others):
        if reached > aim if below else reached < aim:
            misses.append(
                f"{words} {_number(words, reached)} ({'at most' if below else 'at least'} {_number(words, aim)})"
            )
        elif below and words not in _COUNTS and reached < EASILY * aim:
            easy.append(f"{words} {_number(words, reached)}, aim {_number(words, aim)}")
    if misses:
        return Verdict(False, "missed: " + "; ".join(misses))
    return Verdict(True, "met" + (", easily: " + "; ".join(easy) if easy else ""))


_MEDIAN, _MOST, _SUCCESS = "failures at first, median", "failures at first, most", "success"
_STEADY, _ALL_STEADY = "steady from, median", "steady from, last seed"
_COUNTS = (_MEDIAN, _MOST, _STEADY, _ALL_STEADY)


def _figures(
    target: Target, ours: Figures, rule: Figures | None, others: Mapping[str, Figures]
) -> Iterator[tuple[str, float, float, bool]]:
    """Yield what it is, what was reached, what is aimed at, and whether less is better."""
    steady = sorted(math.inf if begin is None else begin for begin in ours["steady_from"])
    plain = (
        (_MEDIAN, ours["first_failures_median"], target.first_median, True),
        (_MOST, ours["first_failures_most"], target.first_most, True),
        (_SUCCESS, ours["success"], target.success, False),
        ("force", ours["force_n"]["mean"], target.force_n, True),
        (_STEADY, steady[len(steady) // 2], target.steady_median, True),
        (_ALL_STEADY, steady[-1], target.steady_all, True),
    )
    yield from ((words, reached, aim, below) for words, reached, aim, below in plain if aim is not None)
    if rule is not None:
        parts = ratio(ours, rule)
        if target.above_rule and ours["success"] < 1.0 and ours["success"] <= rule["success"]:
            yield "success above the rule's", ours["success"], math.nextafter(rule["success"], 2.0), False
        if target.force_of_rule is not None:
            yield "force against the rule", parts.force, target.force_of_rule, True
        if target.moves_of_rule is not None:
            yield "moves against the rule", math.inf if parts.moves is None else parts.moves, target.moves_of_rule, True
    if target.force_as is not None and target.force_as in others:
        yield "force as aligned", ours["force_n"]["mean"], others[target.force_as]["force_n"]["most"], True


def _number(words: str, value: float) -> str:
    if words.startswith("success"):
        return f"{100 * value:.5g} %"
    if words in _COUNTS:
        return "never" if math.isinf(value) else f"{value:g}"
    return f"{value:.2f} N" if words in ("force", "force as aligned") else f"{value:.2f}"
