"""Fewer rows than arrived, with the same extremes: what happens faster than a person can see is not worth streaming."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Nanoseconds = npt.NDArray[np.int64]


def spread(start_ns: int, end_ns: int, rows: int) -> Nanoseconds:
    """Return times for ``rows`` values that came, in order, after ``start_ns`` and until ``end_ns``; shape (rows,).

    The last one is at ``end_ns``. Arrival times would show the jitter of network and process, not of the force.
    """
    return end_ns - (end_ns - start_ns) * np.arange(rows - 1, -1, -1, dtype=np.int64) // max(rows, 1)


def extremes(times_ns: Nanoseconds, values: Floats, buckets: int) -> tuple[Nanoseconds, Floats]:
    """Return at most two rows for each of ``buckets`` runs of consecutive rows.

    Args:
        times_ns: when, rising, shape (n,).
        values: one row a time, shape (n, k), finite.
        buckets: number of runs of about equal length that the rows are split into, at least 1.

    Returns:
        Times of shape (m,) and values of shape (m, k), m <= 2 * buckets. A run of one or two rows stays as it is. Of a
        longer one, each column keeps its least and its greatest value, in the order in which they came: a curve drawn
        through the result spans what a curve through everything would.
    """
    if len(values) <= 2 * buckets:
        return times_ns, values
    edges = np.linspace(0, len(values), buckets + 1).astype(np.int64)
    kept_times: list[Nanoseconds] = []
    kept: list[Floats] = []
    for first, end in pairwise(edges):
        run = values[first:end]
        if len(run) <= 2:
            kept.append(run)
            kept_times.append(times_ns[first:end])
            continue
        least, greatest = run.argmin(axis=0), run.argmax(axis=0)
        columns = np.arange(run.shape[1])
        kept.append(run[np.stack([np.minimum(least, greatest), np.maximum(least, greatest)]), columns])
        kept_times.append(times_ns[[first + len(run) // 4, end - 1]])
    return np.concatenate(kept_times), np.concatenate(kept)


def distinct(times_ns: Nanoseconds, numbers: npt.NDArray[np.int64]) -> tuple[Nanoseconds, npt.NDArray[np.int64]]:
    """Return each different number once, at the time when it came last; both of shape (n,) before, (m,) after.

    For numbers that are names, such as states: a range of them means nothing, which of them came does.
    """
    _, last = np.unique(numbers[::-1], return_index=True)
    rows = np.sort(len(numbers) - 1 - last)
    return times_ns[rows], numbers[rows]
