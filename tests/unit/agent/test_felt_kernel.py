"""The felt model's arithmetic against numpy's, and against the same by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from services.agent import felt_kernel as kernel

UNIT_N = 3.0
Array = NDArray[np.float64]
wrenches = st.lists(st.floats(-1e3, 1e3), min_size=6, max_size=6).map(np.array)


def features(wrench: Array, size: float = 1.0) -> Array:
    plain, out = np.empty(kernel.FEATURES), np.empty(kernel.FEATURES)
    kernel.features(wrench, UNIT_N, plain)
    kernel.sized(plain, size, out)
    return out


@given(st.floats(0, 1e3), st.floats(0, 1e3))
def test_squash_is_tanh_and_never_above_one(x: float, y: float) -> None:
    assert kernel.squash(x) == pytest.approx(math.tanh(x), abs=2e-4)
    low, high = sorted((x, y))
    assert kernel.squash(low) <= kernel.squash(high) <= 1.0


def test_the_features_are_the_documented_ones() -> None:
    wrench = np.array([3.0, 0.0, -4.0, 0.0, 12.0, 0.0])  # of size 13
    unit, bounded = wrench / 13.0, math.tanh(13.0 / UNIT_N)
    expected = [*unit, *(wrench / UNIT_N), *(bounded * unit), 1.0, 13.0 / UNIT_N, bounded, *np.abs(unit)]
    assert features(wrench) == pytest.approx(expected, abs=2e-4)


@given(wrenches, st.floats(0.1, 1.0))
def test_opposite_moves_differ_in_the_odd_features_only(wrench: Array, size: float) -> None:
    there, back = features(wrench, size), features(wrench, -size)
    assert there[: kernel.ODD].tolist() == (-back[: kernel.ODD]).tolist()
    assert there[kernel.ODD :].tolist() == back[kernel.ODD :].tolist()


@given(wrenches)
def test_no_wrench_at_all_has_no_direction(wrench: Array) -> None:
    assert np.isfinite(features(wrench)).all()
    assert features(np.zeros(6))[: kernel.ODD].tolist() == [0.0] * kernel.ODD


@pytest.mark.parametrize("drift", [0.0, 0.01])
def test_step_by_step_it_is_the_ridge_regression_of_all(drift: float) -> None:
    draws = np.random.default_rng(5)
    theta, covariance, most = np.zeros(kernel.FEATURES), np.eye(kernel.FEATURES) / 2.0, 0.5
    inverse, moment = 2.0 * np.eye(kernel.FEATURES), np.zeros(kernel.FEATURES)
    for _ in range(300):
        wrench, size, reward = draws.normal(0.0, 4.0, 6), float(draws.choice([-1.0, 0.5, 1.0])), float(draws.normal())
        kernel.fit(wrench, UNIT_N, size, reward, drift, most, theta, covariance)
        x = features(wrench, size)
        if drift:  # what is held becomes less sure before the next is seen, though never less than at first
            mean, before = np.linalg.solve(inverse, moment), np.linalg.inv(inverse)
            first = most * np.eye(kernel.FEATURES)
            inverse = np.linalg.inv((1.0 - drift) * before + drift * first).astype(np.float64)
            moment = (inverse @ mean).astype(np.float64)
        inverse, moment = inverse + np.outer(x, x), moment + reward * x
        assert (covariance == covariance.T).all()
    assert theta == pytest.approx(np.linalg.solve(inverse, moment), abs=1e-6)
    assert covariance == pytest.approx(np.linalg.inv(inverse), abs=1e-6)
    assert np.linalg.eigvalsh(covariance).max() <= most + 1e-12


def test_what_has_changed_is_learnt_again_only_where_it_may_have() -> None:
    wrench, most = np.array([0.4, 0.0, -1.0, 0.0, 0.2, 0.0]), 1.0
    told = {}
    for drift in (0.0, 0.01):
        theta, covariance = np.zeros(kernel.FEATURES), np.eye(kernel.FEATURES)
        for reward in (5.0,) * 300 + (-5.0,) * 30:
            kernel.fit(wrench, UNIT_N, 1.0, reward, drift, most, theta, covariance)
        told[drift] = float(theta @ features(wrench, 1.0))
    assert told[0.0] > 3.0, "three hundred observations outweigh thirty"
    assert told[0.01] < -2.0


def test_what_is_judged_is_the_mean_and_the_deviation_of_each_move() -> None:
    draws = np.random.default_rng(6)
    lines, sizes = np.array([0, 0, 1], np.int64), np.array([1.0, -0.5, 1.0])
    theta = draws.normal(size=(2, kernel.FEATURES))
    roots = draws.normal(size=(2, kernel.FEATURES, kernel.FEATURES))
    covariances = roots @ roots.transpose(0, 2, 1)
    wrench, out = draws.normal(0.0, 4.0, 6), np.empty((2, 3))
    kernel.judge(wrench, UNIT_N, lines, sizes, theta, covariances, out)
    for action, (line, size) in enumerate(zip(lines.tolist(), sizes.tolist(), strict=True)):
        x = features(wrench, size)
        assert out[0, action] == pytest.approx(theta[line] @ x)
        assert out[1, action] == pytest.approx(math.sqrt(x @ covariances[line] @ x))
