"""How a number of the thesis compares with ours, of several seeds: it matches, ours is better, or it differs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

BAND_PERCENT = (5.0, 95.0)
"""Percentiles over the seeds between which the 90 % interval lies."""


class Verdict(StrEnum):
    """What a comparison with the thesis comes to."""

    MATCHES = "matches"
    BEATS = "beats"
    DIFFERS = "differs"
    APART = "apart"
    """The two are not one task, so that neither number is better or worse."""


Rule: TypeAlias = Callable[[Sequence[float]], Verdict]
"""Says from the values of all seeds, at least one, what the comparison comes to."""
Better: TypeAlias = Literal["lower", "higher"] | None
"""Which side of the thesis's number is better; None where neither is."""


class Interval(NamedTuple):
    """Median of the seeds and the interval from the 5th to the 95th percentile."""

    low: float
    median: float
    high: float


def interval(values: Sequence[float]) -> Interval:
    """Return median and 90 % interval of one or more values, one a seed; ValueError when there is none."""
    if not values:
        raise ValueError("values of the seeds: expected one or more, got none")
    # To the next seed outwards, so that the interval really holds so many of few seeds, and counts stay whole.
    low = np.percentile(values, BAND_PERCENT[0], method="lower")
    high = np.percentile(values, BAND_PERCENT[1], method="higher")
    return Interval(float(low), float(np.median(values)), float(high))


def near(thesis: float, tolerance: float, better: Better = None) -> Rule:
    """Matches when the median is at most ``tolerance`` (0 or more, in the value's unit) away from the thesis's number.

    Farther away it beats it on the ``better`` side, and differs otherwise.
    """

    def rule(values: Sequence[float]) -> Verdict:
        median = interval(values).median
        return _outside(thesis - tolerance, median, median, thesis + tolerance, better)

    return rule


def among(thesis: float, better: Better = None) -> Rule:
    """Matches when the thesis's number, of one run, lies in our 90 % interval: it could have been one of ours.

    Otherwise it beats it where the whole interval is on the ``better`` side, and differs on the other.
    """

    def rule(values: Sequence[float]) -> Verdict:
        low, _, high = interval(values)
        return _outside(thesis, low, high, thesis, better)

    return rule


def at_most(limit: float, beats_at: float | None = None) -> Rule:
    """Matches when the median is at most ``limit``, and beats when it is at most ``beats_at``."""

    def rule(values: Sequence[float]) -> Verdict:
        median = interval(values).median
        if beats_at is not None and median <= beats_at:
            return Verdict.BEATS
        return Verdict.MATCHES if median <= limit else Verdict.DIFFERS

    return rule


def at_least(limit: float, beats_at: float | None = None) -> Rule:
    """Matches when the median is at least ``limit``, and beats when it is at least ``beats_at``."""

    def rule(values: Sequence[float]) -> Verdict:
        return at_most(-limit, None if beats_at is None else -beats_at)([-value for value in values])

    return rule


def always(thesis: float) -> Rule:
    """Matches when every seed gives the thesis's number, and differs when one does not."""

    def rule(values: Sequence[float]) -> Verdict:
        return Verdict.MATCHES if values and all(value == thesis for value in values) else Verdict.DIFFERS

    return rule


def _outside(floor: float, low: float, high: float, ceiling: float, better: Better) -> Verdict:
    """Compare [low, high] of ours with [floor, ceiling] of the thesis."""
    if low <= ceiling and high >= floor:
        return Verdict.MATCHES
    side = "higher" if low > ceiling else "lower"
    return Verdict.BEATS if side == better else Verdict.DIFFERS
