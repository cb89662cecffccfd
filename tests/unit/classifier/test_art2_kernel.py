"""Tests of ART2's arithmetic against small cases worked by hand from the thesis's equations.

a = b = 10 and e = 0 unless a test says otherwise.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from services.classifier import art2_kernel as kernel


def test_first_passes_of_f0() -> None:
    """I = (3, 4): from rest w = I, x = (0.6, 0.8), p = q = 0, v = x, u = v. Then nothing moves any more.

    Second pass: w = (3 + 6, 4 + 8), x = (0.6, 0.8), p = q = (0.6, 0.8), v = 11 (0.6, 0.8), u = (0.6, 0.8).
    """
    layer, stimulus = np.zeros((6, 2)), np.array([3.0, 4.0])
    change = kernel.one_pass(layer, stimulus, np.zeros(2), 0.0, 10.0, 10.0, 0.0, 0.1)
    assert layer == pytest.approx(np.array([[3, 4], [0.6, 0.8], [0.6, 0.8], [0.6, 0.8], [0, 0], [0, 0]]))  # w x v u p q
    assert change == pytest.approx(0.8)
    assert kernel.one_pass(layer, stimulus, np.zeros(2), 0.0, 10.0, 10.0, 0.0, 0.1) == pytest.approx(0, abs=1e-15)
    assert layer[kernel.W] == pytest.approx([9.0, 12.0])
    assert layer[kernel.V] == pytest.approx([6.6, 8.8])
    assert layer[kernel.Q] == pytest.approx([0.6, 0.8])


def test_e_enters_each_normalisation() -> None:
    """E = 1, I = (3, 4): x = I/6 = (1/2, 2/3), v = x with norm 5/6, u = v / (1 + 5/6) = (3/11, 4/11)."""
    layer = np.zeros((6, 2))
    kernel.one_pass(layer, np.array([3.0, 4.0]), np.zeros(2), 0.0, 10.0, 10.0, 1.0, 0.1)
    assert layer[kernel.X] == pytest.approx([1 / 2, 2 / 3])
    assert layer[kernel.U] == pytest.approx([3 / 11, 4 / 11])


def test_f_removes_what_is_below_theta_and_keeps_signs() -> None:
    """I = (3, -4, 0), theta = 0.7: x = (0.6, -0.8, 0), of which f leaves (0, -0.8, 0), so that u = (0, -1, 0)."""
    layer = np.zeros((6, 3))
    kernel.settle(layer, np.array([3.0, -4.0, 0.0]), np.zeros(3), 0.0, 10.0, 10.0, 0.0, 0.7)
    assert layer[kernel.U].tolist() == [0.0, -1.0, 0.0]
    assert [kernel.signal(x, 0.5) for x in (-0.6, -0.5, 0.0, 0.5, 0.6)] == [-0.6, 0.0, 0.0, 0.0, 0.6]


def test_a_pass_of_f1_under_top_down_weights() -> None:
    """Q' = u = (0.6, 0.8), z = (0, 10), d = 0.9, theta = 0.1.

    p = (0.6, 0.8 + 9), norm sqrt(96.4) = 9.81835; q = (0.06111, 0.99813), of which f leaves the second; x = (0.6, 0.8);
    v = (0.6, 0.8 + 9.9813), norm sqrt(0.36 + 116.2366) = 10.79799; u = (0.055566, 0.998455).
    """
    layer = np.zeros((6, 2))
    layer[kernel.U] = 0.6, 0.8
    kernel.one_pass(layer, np.array([0.6, 0.8]), np.array([0.0, 10.0]), 0.9, 10.0, 10.0, 0.0, 0.1)
    assert layer[kernel.P] == pytest.approx([0.6, 9.8])
    assert layer[kernel.Q] == pytest.approx([0.061110, 0.998131], abs=1e-6)
    assert layer[kernel.V] == pytest.approx([0.6, 10.781313], abs=1e-5)
    assert layer[kernel.U] == pytest.approx([0.055566, 0.998455], abs=1e-6)


def test_match_of_orthogonal_and_of_parallel_vectors() -> None:
    """Q' = (1, 0), p = (1, 9), c = 0.1: r = (1.1, 0.9) / (1 + 0.1 sqrt(82)), norm 1.421267 / 1.905539 = 0.745861."""
    priming = np.array([1.0, 0.0])
    assert kernel.match_of(priming, np.array([1.0, 9.0]), 0.1, 0.0) == pytest.approx(0.745861, abs=1e-6)
    assert kernel.match_of(priming, np.array([10.0, 0.0]), 0.1, 0.0) == pytest.approx(1.0)
    # With e = 0.1: (1 + 0.1 * 10) / (0.1 + 1 + 1)
    assert kernel.match_of(priming, np.array([10.0, 0.0]), 0.1, 0.1) == pytest.approx(2 / 2.1)


def search(rho: float, f2: NDArray[np.float64]) -> tuple[int, int, float]:
    """Present (3, 4) to units that stand for x and y."""
    weights = np.array([[10.0, 0.0], [0.0, 10.0], [0.0, 0.0]])
    layers = np.zeros((2, 6, 2))
    return kernel.search(
        np.array([3.0, 4.0]), weights, 2, layers[0], layers[1], f2, 10.0, 10.0, 0.1, 0.9, 0.0, 0.0, rho
    )


def test_f2_takes_the_largest_input() -> None:
    """P = (0.6, 0.8), so T = (6, 8): the second unit is tried first, and at a low vigilance it is taken."""
    f2 = np.zeros(3)
    assert search(0.5, f2)[:2] == (1, 1)
    assert f2 == pytest.approx([6.0, 8.0, 0.0])


def test_reset_units_stay_inhibited_until_none_is_left() -> None:
    """Settled u is close to z, so ||r|| is close to cos(36.87/2 deg) = 0.9487 for y and cos(53.13/2 deg) = 0.8944."""
    f2 = np.zeros(3)
    unit, nearest, match = search(0.97, f2)
    assert (unit, nearest) == (kernel.NO_UNIT, 1)
    assert match == pytest.approx(math.cos(math.acos(0.8) / 2), abs=2e-3)
    assert f2[:2].tolist() == [-math.inf, -math.inf]


def test_a_reset_leaves_no_trace_in_f1() -> None:
    """T = (7.66, 6.06): the unit at 40 degrees is reset first; the one at 30 then matches as if it were alone."""
    first, second = np.radians(40.0), np.radians(30.0)
    weights = np.array([[10 * np.cos(first), 10 * np.sin(first)], [7 * np.cos(second), 7 * np.sin(second)]])
    stimulus, layers = np.array([1.0, 0.0]), np.zeros((2, 6, 2))
    parameters = 10.0, 10.0, 0.1, 0.9, 0.0, 0.05, 0.999
    both = kernel.search(stimulus, weights, 2, layers[0], layers[1], np.zeros(2), *parameters)
    alone = kernel.search(stimulus, weights[1:], 1, layers[0], layers[1], np.zeros(2), *parameters)
    assert both == (kernel.NO_UNIT, 1, alone[2])


def test_learning_goes_part_of_the_way_to_equilibrium() -> None:
    """Z = (10, 0), u = (0.6, 0.8), d = 0.9: u / (1 - d) = (6, 8), and half way there is (8, 4)."""
    weights = np.array([[1.0, 1.0], [10.0, 0.0]])
    kernel.learn(weights, 1, np.array([0.6, 0.8]), 0.9, 0.5)
    assert weights == pytest.approx(np.array([[1.0, 1.0], [8.0, 4.0]]))


def test_default_settings_settle_in_a_few_passes() -> None:
    layer, z = np.zeros((6, 2)), np.array([0.0, 10.0])
    assert kernel.settle(layer, np.array([0.6, 0.8]), z, 0.9, 10.0, 10.0, 0.0, 0.05) < 20
    before = layer.copy()
    kernel.one_pass(layer, np.array([0.6, 0.8]), z, 0.9, 10.0, 10.0, 0.0, 0.05)
    assert layer == pytest.approx(before, abs=1e-9)


def test_activities_that_do_not_settle_end_after_the_bound() -> None:
    layer = np.zeros((6, 2))
    layer[kernel.U] = 1.0, 0.0
    passes = kernel.settle(layer, np.array([0.6, 0.8]), np.array([0.0, 10.0]), 0.001, 100.0, 100.0, 0.0, 0.0)
    assert passes == kernel.PASSES
