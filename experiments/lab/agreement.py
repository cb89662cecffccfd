"""How well two labellings of the same things agree: adjusted Rand index and purity. Pure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def contingency(labels: Sequence[int], true: Sequence[int]) -> NDArray[np.int64]:
    """Return how many things have each pair of labels, shape (labels found, true labels), labels in ascending order.

    Raises ValueError for labellings of different lengths, or of nothing.
    """
    if len(labels) != len(true) or not len(labels):
        raise ValueError(f"labels: expected as many of both, at least one, got {len(labels)} and {len(true)}")
    rows, row_of = np.unique(np.asarray(labels), return_inverse=True)
    columns, column_of = np.unique(np.asarray(true), return_inverse=True)
    table = np.zeros((len(rows), len(columns)), dtype=np.int64)
    np.add.at(table, (row_of, column_of), 1)
    return table


def adjusted_rand_index(labels: Sequence[int], true: Sequence[int]) -> float:
    """Return the adjusted Rand index (Hubert and Arabie, 1985): 1 for equal partitions, about 0 for chance.

    Two partitions that are both a single group, or both all singles, are equal and give 1. Raises like
    ``contingency``.
    """
    table = contingency(labels, true)
    together = _pairs(table)
    of_found, of_true = _pairs(table.sum(axis=1)), _pairs(table.sum(axis=0))
    everything = _pairs(np.array([table.sum()]))
    if everything == 0 or (of_found == of_true and of_found in (0, everything)):
        return 1.0
    chance = of_found * of_true / everything
    return (together - chance) / ((of_found + of_true) / 2 - chance)


def purity(labels: Sequence[int], true: Sequence[int]) -> float:
    """Return the fraction of things that have the commonest true label of their group, in (0, 1].

    It can only rise as groups are split, so it means something only beside their number. Raises like ``contingency``.
    """
    table = contingency(labels, true)
    return float(table.max(axis=1).sum() / table.sum())


def _pairs(counts: NDArray[np.int64]) -> int:
    """How many pairs can be formed within groups of these sizes."""
    return int((counts * (counts - 1) // 2).sum())
