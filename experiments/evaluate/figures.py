"""What an evaluation comes to: success with its interval, forces, moves, time."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple, TypedDict

from experiments.evaluate.trial import Trial

Z95 = 1.959963984540054
"""Two-sided 95 % point of the normal distribution."""


class Interval(NamedTuple):
    """A confidence interval of a fraction."""

    low: float
    high: float


class Figures(TypedDict):
    """Figures over all episodes of all seeds; forces are means over all moves of an episode, free ones included."""

    episodes: int
    seeds: list[int]
    successes: int
    success: float
    """Part of the episodes that ended inserted."""
    success_low: float
    """Lower end of its 95 % interval (Wilson)."""
    success_high: float
    outcomes: dict[str, int]
    force_n: float
    """Mean over the episodes of the mean force of each."""
    peak_force_n: float
    """Mean over the episodes of the greatest force of each."""
    greatest_force_n: float
    moves: float
    """Mean over the episodes that ended inserted; NaN is never given: 0 when there is none."""
    seconds: float
    """What that takes at the stated rate of motion."""
    moves_per_s: float
    states: int
    """Contact states that decisions were taken for."""


def wilson(successes: int, trials: int) -> Interval:
    """Return the 95 % score interval of a success rate (Wilson 1927). Raises ValueError for counts that are none."""
    if not 0 <= successes <= trials or trials == 0:
        raise ValueError(f"success rate: expected 0 to {trials} of one or more trials, got {successes} of {trials}")
    rate, square = successes / trials, Z95 * Z95
    middle = (rate + square / (2 * trials)) / (1 + square / trials)
    half = Z95 * math.sqrt(rate * (1 - rate) / trials + square / (4 * trials * trials)) / (1 + square / trials)
    # At none and at all the interval begins, or ends, there; rounding must not say otherwise.
    return Interval(0.0 if successes == 0 else middle - half, 1.0 if successes == trials else middle + half)


def figures(trials: Sequence[Trial], moves_per_s: float) -> Figures:
    """Return the figures of one or more seeds' episodes, at a rate of motions in a second above 0."""
    episodes = [summary for trial in trials for summary in trial.episodes]
    inserted = [summary for summary in episodes if summary.outcome == "inserted"]
    low, high = wilson(len(inserted), len(episodes))
    moves = statistics.fmean(summary.moves for summary in inserted) if inserted else 0.0
    return {
        "episodes": len(episodes),
        "seeds": [trial.seed for trial in trials],
        "successes": len(inserted),
        "success": len(inserted) / len(episodes),
        "success_low": low,
        "success_high": high,
        "outcomes": dict(sorted(Counter(summary.outcome for summary in episodes).items())),
        "force_n": statistics.fmean(summary.mean_force_n for summary in episodes),
        "peak_force_n": statistics.fmean(summary.peak_force_n for summary in episodes),
        "greatest_force_n": max(summary.peak_force_n for summary in episodes),
        "moves": moves,
        "seconds": moves / moves_per_s,
        "moves_per_s": moves_per_s,
        "states": len(frozenset().union(*(trial.states for trial in trials))),
    }
