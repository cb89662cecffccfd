"""The numbers of one run of insertions, and those of all seeds beside the thesis's."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import groupby
from typing import NamedTuple

from experiments.reproduce.chapter import Comparison, Table, spread
from experiments.reproduce.insertion_runs import Gone
from experiments.reproduce.insertion_thesis import Reported, Said
from experiments.reproduce.verdicts import Rule, Verdict, at_least, at_most, interval, near
from services.rules.results import steady_after

RETURN_TOLERANCE = 0.25
"""As a part of the thesis's return."""
END = 100
"""Episodes at the end of a run that "finally" stands for."""
NEVER = math.inf
"""Stands for what never came: later than any episode, and more than any count."""
WHY = "See the page of this experiment in docs/experiments."


class Figures(NamedTuple):
    """What is compared of one run; return, force, torque and success are means over its last quarter."""

    steady: float
    """Episode from which it is steady; NEVER when it never is."""
    episode_return: float
    force_n: float
    torque_nm: float
    success: float
    force_end_n: float
    """Mean over its last 100 episodes."""
    collisions: float
    collisions_after: float
    """After it was steady; NEVER when it never is, for then there is no such time."""
    longest: float


def figures_of(run: Gone) -> Figures:
    """Return the figures of a run."""
    episodes = len(run.returns)
    last = slice(episodes - math.ceil(episodes / 4), episodes)
    steady = steady_after(run.returns, [letter == "i" for letter in run.outcomes])
    return Figures(
        steady=NEVER if steady is None else steady,
        episode_return=_mean(run.returns[last]),
        force_n=_mean(run.force_n[last]),
        torque_nm=_mean(run.torque_nm[last]),
        success=run.outcomes[last].count("i") / len(run.outcomes[last]),
        force_end_n=_mean(run.force_n[-END:]),
        collisions=run.outcomes.count("c"),
        collisions_after=NEVER if steady is None else run.outcomes[steady:].count("c"),
        longest=max((len(list(group)) for letter, group in groupby(run.outcomes) if letter == "i"), default=0),
    )


class _Row(NamedTuple):
    """How one number of the thesis is compared."""

    reported: str
    """Field of ``Reported``."""
    figure: str
    """Field of ``Figures``."""
    what: str
    form: str
    """How the thesis has the number."""
    rule: Callable[[float], Rule]
    why: str
    """Key of ``Reported.why``."""
    unit: str = ""


def _half(value: float) -> Rule:
    return at_most(value, beats_at=value / 2)


def _fewer(value: float) -> Rule:
    return at_most(value, beats_at=value - 1)


def _near(value: float) -> Rule:
    return near(value, RETURN_TOLERANCE * abs(value), better="higher")


def _longer(value: float) -> Rule:
    return at_least(value, beats_at=2 * value)


_ROWS = (
    _Row("steady_from", "steady", "steady from episode", "about {:g}", _half, "steady"),
    _Row("episode_return", "episode_return", "return, last quarter", "{:g}", _near, "return"),
    _Row("force_n", "force_n", "mean force, last quarter", "{:g} N", _half, "force", "N"),
    _Row("force_end_n", "force_end_n", f"mean force, last {END} episodes", "{:g} N", _half, "force", "N"),
    _Row("torque_nm", "torque_nm", "mean torque, last quarter", "{:g} N m", _half, "torque", "N m"),
    _Row("collisions_after", "collisions_after", "collisions after it was steady", "{:g}", _fewer, "failures"),
    _Row("collisions", "collisions", "collisions in all", "{:g}", _fewer, "failures"),
    _Row("longest", "longest", "longest series of insertions", "more than {:g}", _longer, "failures"),
)


def compare(reported: Reported, figures: Sequence[Figures]) -> list[Comparison]:
    """Return the comparisons of one experiment, those that the thesis has a number for."""
    rows = []
    for row in _ROWS:
        said: Said | None = getattr(reported, row.reported)
        if said is None:
            continue
        values = [float(getattr(figure, row.figure)) for figure in figures]
        never = values.count(NEVER)
        notes = [f"Never steady in {never} of {len(values)} seeds."] if never else []
        why = reported.why.get(row.why, WHY)
        rule: Rule = row.rule(said.value)
        if reported.apart:
            notes.append(reported.apart)
            rule = _apart
        rows.append(
            Comparison(row.what, row.form.format(said.value), values, rule, why, row.unit, note=" ".join(notes))
        )
    # The page's summary shows the rows of all experiments under each other.
    return [replace(row, what=f"{reported.name}: {row.what}") for row in rows]


def aims(reported: Sequence[Reported], figures: Sequence[Sequence[Figures]]) -> Table:
    """Return what we ask of our own runs, where the thesis gives no number; no part of the comparison with it."""
    rows = []
    for experiment, its_figures in zip(reported, figures, strict=True):
        if experiment.success_aim is None:
            continue
        values = [100 * figure.success for figure in its_figures]
        met = "met" if interval(values).median >= 100 * experiment.success_aim else "missed"
        rows.append((experiment.name, f"at least {100 * experiment.success_aim:g} %", f"{spread(values)} %", met))
    head = ("experiment", "success, last quarter: our aim", "Treenail", "")
    return Table("", "Our own aims. The thesis has no number for these, so they say nothing about it.", head, rows)


def _apart(_: Sequence[float]) -> Verdict:
    return Verdict.APART


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)
