"""Policies against eqs. 4.1 to 4.3 worked by hand, and the frequencies that they produce."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.agent.policies import choose, pick, probabilities, select
from services.wire.definition import EpsilonAnnealed, EpsilonGreedy, Greedy, Policy, Softmax

POLICIES: list[Policy] = [
    Greedy(),
    EpsilonGreedy(epsilon=0.1),
    EpsilonGreedy(epsilon=1.0),
    EpsilonAnnealed(mu=0.01),
    Softmax(beta=1.0, beta_per_episode=0.05),
    Softmax(beta=0.0, beta_per_episode=0.0),
]
ROWS = st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=11)


def test_greedy_takes_the_best_action_only() -> None:
    assert probabilities(np.array([1.0, 3.0, 2.0]), Greedy(), 0).tolist() == [0.0, 1.0, 0.0]


def test_greedy_shares_a_tie_evenly() -> None:
    assert probabilities(np.array([3.0, 1.0, 3.0]), Greedy(), 7).tolist() == [0.5, 0.0, 0.5]


def test_epsilon_greedy_is_equation_4_1() -> None:
    chances = probabilities(np.array([0.0, -1.0, 5.0, 2.0]), EpsilonGreedy(epsilon=0.1), 99)
    assert chances == pytest.approx([0.025, 0.025, 1 - 0.1 + 0.1 / 4, 0.025], abs=1e-15)


def test_epsilon_greedy_shares_the_greedy_part_among_ties() -> None:
    chances = probabilities(np.array([1.0, 1.0, 0.0, 0.0]), EpsilonGreedy(epsilon=0.2), 0)
    assert chances == pytest.approx([0.45, 0.45, 0.05, 0.05], abs=1e-15)


@pytest.mark.parametrize(("mu", "episode", "epsilon"), [(0.01, 0, 1.0), (0.01, 100, 0.5), (0.1, 90, 0.1), (1, 3, 0.25)])
def test_annealed_epsilon_is_equation_4_2(mu: float, episode: int, epsilon: float) -> None:
    chances = probabilities(np.array([0.0, 1.0]), EpsilonAnnealed(mu=mu), episode)
    assert chances == pytest.approx([epsilon / 2, 1 - epsilon / 2], abs=1e-15)


def test_softmax_is_equation_4_3() -> None:
    chances = probabilities(np.array([0.0, math.log(2), math.log(3)]), Softmax(beta=1, beta_per_episode=0), 50)
    assert chances == pytest.approx([1 / 6, 2 / 6, 3 / 6], abs=1e-15)


def test_softmax_beta_grows_with_the_episode() -> None:
    chances = probabilities(np.array([0.0, math.log(2)]), Softmax(beta=1, beta_per_episode=0.5), 4)
    assert chances == pytest.approx([1 / 9, 8 / 9], abs=1e-15)  # beta 3: 2 cubed


@pytest.mark.parametrize("scale", [1e3, 1e12, 1e308])
def test_softmax_of_huge_beta_times_value_is_greedy(scale: float) -> None:
    values = np.array([-scale, 0.9 * scale, scale])
    assert probabilities(values, Softmax(beta=1e6, beta_per_episode=1e6), 10**6).tolist() == [0.0, 0.0, 1.0]


def test_softmax_of_beta_0_is_uniform_whatever_the_values() -> None:
    assert probabilities(np.array([-1.7e308, 1.7e308]), Softmax(beta=0, beta_per_episode=0), 9).tolist() == [0.5, 0.5]


@given(ROWS, st.sampled_from(POLICIES), st.integers(0, 10**6))
def test_probabilities_are_a_distribution_that_favours_better_actions(
    row: list[float], policy: Policy, episode: int
) -> None:
    values = np.array(row)
    chances = probabilities(values, policy, episode)
    assert (chances >= 0).all()
    assert chances.sum() == pytest.approx(1.0, abs=1e-12)
    by_value = chances[np.argsort(values, kind="stable")]
    assert (np.diff(by_value) >= 0).all()


@given(ROWS, st.sampled_from(POLICIES), st.integers(0, 1000), st.floats(0, 1))
def test_select_never_returns_an_impossible_action(
    row: list[float], policy: Policy, episode: int, uniform: float
) -> None:
    values = np.array(row)
    assert probabilities(values, policy, episode)[select(values, policy, episode, uniform)] > 0


@given(ROWS, st.sampled_from(POLICIES), st.integers(0, 1000), st.floats(0, 1))
def test_select_draws_from_the_probabilities(row: list[float], policy: Policy, episode: int, uniform: float) -> None:
    values = np.array(row)
    chances = probabilities(values, policy, episode)
    if np.abs(chances.cumsum() - uniform).min() > 1e-12:
        assert select(values, policy, episode, uniform) == pick(chances, uniform)


def test_softmax_draws_alike_with_exponentials_that_differ_in_the_last_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    policy = Softmax(beta=3.0, beta_per_episode=0.0)
    rows = np.random.default_rng(2).normal(size=(30, 9)).tolist()
    on_the_edge = [
        (row, uniform)
        for row in rows
        for edge in probabilities(np.array(row), policy, 0).cumsum().tolist()[:-1]
        for uniform in (edge, math.nextafter(edge, 0.0), math.nextafter(edge, 1.0))
    ]
    here = [choose(row, policy, 0, uniform) for row, uniform in on_the_edge]
    as_doubles = [pick(probabilities(np.array(row), policy, 0), uniform) for row, uniform in on_the_edge]
    assert here != as_doubles, "doubles are expected to go wrong this near to an edge, or the test shows nothing"
    for towards in (0.0, 2.0):
        monkeypatch.setattr(math, "exp", lambda x, to=towards: math.nextafter(np.exp(x), to))
        assert [choose(row, policy, 0, uniform) for row, uniform in on_the_edge] == here


def test_softmax_of_equal_values_shares_exactly() -> None:
    policy = Softmax(beta=3.0, beta_per_episode=0.0)
    drawn = [choose([0.5] * 4, policy, 0, uniform) for uniform in (0.0, 0.25, math.nextafter(0.25, 0.0), 0.75, 1.0)]
    assert drawn == [0, 1, 0, 3, 3]


@pytest.mark.parametrize(
    ("uniform", "index"),
    [(0.0, 1), (0.2499, 1), (0.25, 3), (0.9999, 3), (math.nextafter(1.0, 0.0), 3), (1.0, 3)],
)
def test_pick_is_the_inverse_of_the_cumulative_sum(uniform: float, index: int) -> None:
    assert pick(np.array([0.0, 0.25, 0.0, 0.75, 0.0]), uniform) == index


def test_pick_where_rounding_leaves_the_sum_short_of_1() -> None:
    chances = np.array([0.1] * 10 + [0.0])
    assert np.cumsum(chances)[-1] < 1.0
    assert pick(chances, math.nextafter(1.0, 0.0)) == 9


@pytest.mark.parametrize("policy", POLICIES)
def test_frequencies_follow_the_probabilities(policy: Policy) -> None:
    values, draws = np.array([-1.0, 0.5, 0.5, -2.0]), 10_000
    uniform = np.random.default_rng(1).random(draws)
    counts = np.bincount([select(values, policy, 20, float(u)) for u in uniform], minlength=4)
    expected = probabilities(values, policy, 20)
    assert np.abs(counts / draws - expected).max() <= 4 * np.sqrt(expected * (1 - expected) / draws).max()
    assert not counts[expected == 0].any()


@pytest.mark.parametrize("values", [[], [[1.0, 2.0]], [0.0, math.nan], [0.0, math.inf]])
def test_values_that_are_no_finite_row_are_refused(values: list[object]) -> None:
    with pytest.raises(ValueError, match="action values: expected a row of one or more finite numbers"):
        probabilities(np.array(values, dtype=np.float64), Greedy(), 0)


def test_a_negative_episode_is_refused() -> None:
    with pytest.raises(ValueError, match="episode: expected 0 or more, got -1"):
        probabilities(np.zeros(2), EpsilonAnnealed(mu=0.5), -1)


@pytest.mark.parametrize("uniform", [-1e-9, 1.0000001, math.nan])
def test_a_uniform_number_out_of_range_is_refused(uniform: float) -> None:
    with pytest.raises(ValueError, match="uniform random number: expected 0 to 1"):
        select(np.zeros(2), Greedy(), 0, uniform)
