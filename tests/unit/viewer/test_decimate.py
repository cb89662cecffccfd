"""Decimation loses rows, never extremes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from services.viewer.decimate import Floats, distinct, extremes, spread

tables = hnp.arrays(
    np.float64,
    st.tuples(st.integers(1, 200), st.integers(1, 7)),
    elements=st.floats(-1e3, 1e3, allow_nan=False),
)


@given(values=tables, buckets=st.integers(1, 20))
def test_extremes_of_every_column_survive(values: Floats, buckets: int) -> None:
    _, kept = extremes(np.arange(len(values)), values, buckets)
    assert (kept.min(axis=0) == values.min(axis=0)).all()
    assert (kept.max(axis=0) == values.max(axis=0)).all()


@given(values=tables, buckets=st.integers(1, 20))
def test_result_is_bounded_rising_and_made_of_what_came(values: Floats, buckets: int) -> None:
    times = np.arange(len(values), dtype=np.int64) * 10
    kept_times, kept = extremes(times, values, buckets)
    assert len(kept) == len(kept_times) <= 2 * buckets
    assert (np.diff(kept_times) > 0).all()
    assert np.isin(kept_times, times).all()
    for column in range(values.shape[1]):
        assert np.isin(kept[:, column], values[:, column]).all()


@given(values=tables)
def test_few_rows_stay_as_they_are(values: Floats) -> None:
    times = np.arange(len(values), dtype=np.int64)
    kept_times, kept = extremes(times, values, len(values))
    assert (kept == values).all() and (kept_times == times).all()


def test_each_column_keeps_its_own_order_of_extremes() -> None:
    values = np.array([[0.0, 0.0], [9.0, -9.0], [1.0, 1.0], [-9.0, 9.0], [0.0, 0.0]])
    _, kept = extremes(np.arange(5), values, 1)
    assert kept.tolist() == [[9.0, -9.0], [-9.0, 9.0]]


def test_a_single_peak_among_many_survives_in_its_bucket() -> None:
    values = np.zeros((1000, 1))
    values[333, 0] = 12.0
    times, kept = extremes(np.arange(1000), values, 10)
    assert kept.max() == 12.0
    assert 300 <= times[kept[:, 0].argmax()] < 400


@given(start=st.integers(0, 10**15), length=st.integers(1000, 10**9), rows=st.integers(0, 500))
def test_spread_times_rise_within_the_interval_up_to_its_end(start: int, length: int, rows: int) -> None:
    times = spread(start, start + length, rows)
    assert times.shape == (rows,) and times.dtype == np.int64
    if rows:
        assert times[-1] == start + length
        assert times[0] > start
        assert (np.diff(times) > 0).all()


@pytest.mark.parametrize(
    ("numbers", "times", "kept"),
    [([], [], []), ([4], [0], [4]), ([1, 2, 1, 1], [1, 3], [2, 1]), ([3, 3, 3], [2], [3])],
)
def test_distinct_keeps_each_number_when_it_came_last(numbers: list[int], times: list[int], kept: list[int]) -> None:
    got_times, got = distinct(np.arange(len(numbers), dtype=np.int64), np.array(numbers, dtype=np.int64))
    assert got_times.tolist() == times
    assert got.tolist() == kept
