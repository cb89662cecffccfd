"""What the runs of one method on one task come to, over their seeds."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypedDict

from experiments.evaluate.figures import wilson
from experiments.leaderboard.jobs import Outcome
from services.rules.results import steady_after

FIRST = 20
"""Episodes whose failures a person feels: an insertion that fails is a scratched part."""
LAST = 100
"""Episodes at the end that say how good a method becomes; a third of a run that is shorter than 300."""
INSERTED = "i"


class Spread(TypedDict):
    """A mean over all seeds, and the least and the most of the seeds' own means."""

    mean: float
    least: float
    most: float


class Figures(TypedDict):
    """One method on one task."""

    seeds: list[int]
    episodes: int
    """Of each seed."""
    first_failures: list[int]
    """Failures in the first episodes, by seed."""
    first_failures_median: float
    first_failures_most: int
    last: int
    """Episodes at the end of each run that what follows is about."""
    successes: int
    trials: int
    success: float
    success_low: float
    """Lower end of its 95 % interval (Wilson), all seeds pooled."""
    success_high: float
    success_worst_seed: float
    force_n: Spread
    """Mean force over all moves of an episode, free ones included."""
    peak_n: Spread
    """Greatest force of an episode."""
    moves: Spread | None
    """Of insertions that succeeded; None where none did."""
    steady_from: list[int | None]
    """Episodes after which each run is steady, None where it never is (services/rules/results.py)."""
    states: int
    """Contact states known at the end, median."""
    cpu_s: float
    """Seconds of one core, all seeds."""


class Ratio(NamedTuple):
    """Force and moves as parts of somebody else's."""

    force: float
    moves: float | None


def last_of(episodes: int) -> int:
    """Return how many episodes at the end of a run are looked at."""
    return min(LAST, max(1, episodes // 3))


def figures(outcomes: Mapping[int, Outcome], learns: bool) -> Figures:
    """Return the figures of one or more seeds' outcomes, each as long as the others.

    Of who does not learn all episodes count, not the last alone: they are all alike.
    """
    seeds = sorted(outcomes)
    whole = [outcomes[seed] for seed in seeds]
    episodes = len(whole[0].outcomes)
    last = last_of(episodes) if learns else episodes
    inserted = [outcome.outcomes[-last:].count(INSERTED) for outcome in whole]
    low, high = wilson(sum(inserted), last * len(seeds))
    first = [FIRST - outcome.outcomes[:FIRST].ljust(FIRST, INSERTED).count(INSERTED) for outcome in whole]
    return {
        "seeds": seeds,
        "episodes": episodes,
        "first_failures": first,
        "first_failures_median": statistics.median(first),
        "first_failures_most": max(first),
        "last": last,
        "successes": sum(inserted),
        "trials": last * len(seeds),
        "success": sum(inserted) / (last * len(seeds)),
        "success_low": low,
        "success_high": high,
        "success_worst_seed": min(inserted) / last,
        "force_n": _spread([outcome.force_n[-last:] for outcome in whole]),
        "peak_n": _spread([outcome.peak_n[-last:] for outcome in whole]),
        "moves": _moves(whole, last),
        "steady_from": [
            steady_after(outcome.returns, [end == INSERTED for end in outcome.outcomes]) for outcome in whole
        ],
        "states": round(statistics.median(outcome.states for outcome in whole)),
        "cpu_s": sum(outcome.cpu_s for outcome in whole),
    }


def ratio(ours: Figures, theirs: Figures) -> Ratio:
    """Return our force and moves as parts of theirs."""
    moves = (
        None if ours["moves"] is None or theirs["moves"] is None else ours["moves"]["mean"] / theirs["moves"]["mean"]
    )
    return Ratio(ours["force_n"]["mean"] / theirs["force_n"]["mean"], moves)


def _moves(whole: Sequence[Outcome], last: int) -> Spread | None:
    of_seeds = [
        [moves for moves, end in zip(outcome.moves[-last:], outcome.outcomes[-last:], strict=True) if end == INSERTED]
        for outcome in whole
    ]
    some = [moves for moves in of_seeds if moves]
    return _spread(some) if some else None


def _spread(of_seeds: Sequence[Sequence[float]]) -> Spread:
    means = [statistics.fmean(values) for values in of_seeds]
    every = [value for values in of_seeds for value in values]
    return {"mean": statistics.fmean(every), "least": min(means), "most": max(means)}
