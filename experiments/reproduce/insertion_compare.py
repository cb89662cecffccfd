"""The numbers of one run of insertions, and those of all seeds beside the thesis's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from typing import NamedTuple

from experiments.reproduce.chapter import Comparison
from experiments.reproduce.insertion_runs import Gone
from experiments.reproduce.insertion_thesis import Reported
from experiments.reproduce.verdicts import at_least, at_most, near
from services.rules.results import steady_after

RETURN_TOLERANCE = 0.25
"""As a part of the thesis's return."""
WHY = "See the page of this experiment in docs/experiments."


class Figures(NamedTuple):
    """What is compared of one run; all but the first and the last three are means over its last quarter."""

    steady: float
    """Episode from which it is steady; the length of the run when it never is."""
    episode_return: float
    force_n: float
    torque_nm: float
    success: float
    collisions: float
    collisions_after: float
    longest: float


def figures_of(run: Gone) -> Figures:
    """Return the figures of a run."""
    episodes = len(run.returns)
    last = slice(episodes - math.ceil(episodes / 4), episodes)
    steady = steady_after(run.returns, [letter == "i" for letter in run.outcomes])
    start = episodes if steady is None else steady
    return Figures(
        steady=start,
        episode_return=_mean(run.returns[last]),
        force_n=_mean(run.force_n[last]),
        torque_nm=_mean(run.torque_nm[last]),
        success=run.outcomes[last].count("i") / len(run.outcomes[last]),
        collisions=run.outcomes.count("c"),
        collisions_after=run.outcomes[start:].count("c"),
        longest=max((len(list(group)) for letter, group in groupby(run.outcomes) if letter == "i"), default=0),
    )


def compare(reported: Reported, figures: Sequence[Figures], episodes: int) -> list[Comparison]:
    """Return the comparisons of one experiment, those that the thesis has a number for; runs of ``episodes``."""
    rows: list[Comparison] = []

    def why(quantity: str) -> str:
        return reported.why.get(quantity, WHY)

    if (steady := reported.steady_from) is not None:
        values = [figure.steady for figure in figures]
        never = sum(figure.steady == episodes for figure in figures)
        note = f"Never steady in {never} of {len(figures)} seeds." if never else ""
        rule = at_most(steady, beats_at=steady / 2)
        rows.append(Comparison("steady from episode", f"about {steady}", values, rule, why("steady"), note=note))
    if (gain := reported.episode_return) is not None:
        values = [figure.episode_return for figure in figures]
        rule = near(gain, RETURN_TOLERANCE * abs(gain), better="higher")
        rows.append(Comparison("return, last quarter", f"{gain:g}", values, rule, why("return")))
    if (force := reported.force_n) is not None:
        values = [figure.force_n for figure in figures]
        rule = at_most(force, beats_at=force / 2)
        rows.append(Comparison("mean force, last quarter", f"at most {force:g} N", values, rule, why("force"), "N"))
    if (torque := reported.torque_nm) is not None:
        values = [figure.torque_nm for figure in figures]
        rule = at_most(torque, beats_at=torque / 2)
        rows.append(
            Comparison("mean torque, last quarter", f"about {torque:g} N m", values, rule, why("torque"), "N m")
        )
    rows += _failures(reported, figures, why("failures"))
    # The page's summary shows the rows of all experiments under each other.
    return [replace(row, what=f"{reported.name}: {row.what}") for row in rows]


def _failures(reported: Reported, figures: Sequence[Figures], why: str) -> list[Comparison]:
    rows: list[Comparison] = []
    if (success := reported.success) is not None:
        values = [100 * figure.success for figure in figures]
        rule = at_least(100 * success)
        aim = f"no number; aim {100 * success:g} %"
        rows.append(Comparison("success, last quarter", aim, values, rule, why, "%"))
    if (after := reported.collisions_after) is not None:
        values = [figure.collisions_after for figure in figures]
        rule = at_most(after, beats_at=after - 1)
        rows.append(Comparison("collisions after that", f"{after}", values, rule, why))
    if (collisions := reported.collisions) is not None:
        values = [figure.collisions for figure in figures]
        rule = at_most(collisions, beats_at=collisions - 1)
        rows.append(Comparison("collisions in all", f"{collisions}", values, rule, why))
    if (longest := reported.longest) is not None:
        values = [figure.longest for figure in figures]
        rule = at_least(longest, beats_at=2 * longest)
        rows.append(Comparison("longest series of insertions", f"{longest}", values, rule, why))
    return rows


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)
