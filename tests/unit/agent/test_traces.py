"""Traces and repeated moves, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from services.agent.learning import Learner
from services.agent.policies import faded, goes_on
from services.agent.traces import SMALLEST, Traces
from services.wire.definition import EpsilonGreedy, Greedy, QLearning, Sarsa, Softmax

ALPHA, GAMMA, TRACE = 0.5, 0.8, 0.5
EXPLORING = EpsilonGreedy(epsilon=1.0)


def test_shares_fall_and_the_smallest_are_none() -> None:
    traces = Traces(0.1)
    for state in range(3):
        traces.mark(state, 0)
        assert [place[0] for place in traces.shares()][-1] == state
        traces.fall()
    assert list(traces.shares()) == [(1, 0, pytest.approx(SMALLEST)), (2, 0, 0.1)]


def walk(learner: Learner) -> None:
    """Two moves that cost 1 and an end that is worth 10."""
    first = learner.decide(None, 0, 0, 0)
    second = learner.decide((0, first, -1.0), 1, 0, 1)
    third = learner.decide((1, second, -1.0), 2, 0, 2)
    learner.finish((2, third, 10.0))


@pytest.mark.parametrize("settings", [QLearning, Sarsa])
def test_a_lesson_reaches_back_to_the_decisions_before(settings: type[QLearning | Sarsa]) -> None:
    learner = Learner(1, settings(alpha=ALPHA, gamma=GAMMA, trace=TRACE), Greedy(), 3)
    walk(learner)
    decay = GAMMA * TRACE
    # Errors in turn: -1 at state 0, -1 at 1 (the next values are still 0), 10 at 2.
    expected = [-1 - decay + 10 * decay**2, -1 + 10 * decay, 10]
    assert learner.q[:, 0] == pytest.approx([ALPHA * value for value in expected])
    assert learner.visits[:, 0].tolist() == [1, 1, 1]
    assert learner.version == 3


def test_without_traces_it_does_not() -> None:
    learner = Learner(1, QLearning(alpha=ALPHA, gamma=GAMMA), Greedy(), 3)
    walk(learner)
    assert learner.q[:, 0].tolist() == [-0.5, -0.5, 5.0]


def test_watkins_forgets_what_led_to_a_move_that_is_not_the_best() -> None:
    for seed in range(50):
        learner = Learner(2, QLearning(alpha=ALPHA, gamma=GAMMA, trace=1.0), EXPLORING, seed)
        learner.update(1, 1, 5.0, None, None)  # at 1, +1 is best; that ends no episode of decide
        first = learner.decide(None, 0, 0, 0)
        second = learner.decide((0, first, -1.0), 1, 0, 1)
        before = learner.values(0)[first]
        learner.finish((1, second, 100.0))
        assert (learner.values(0)[first] != before) == (second == 1)


def test_sarsa_goes_on_through_it() -> None:
    learner = Learner(2, Sarsa(alpha=ALPHA, gamma=GAMMA, trace=1.0), EXPLORING, 1)
    first = learner.decide(None, 0, 0, 0)
    second = learner.decide((0, first, -1.0), 1, 0, 1)
    before = learner.values(0)[first]
    learner.finish((1, second, 100.0))
    assert learner.values(0)[first] > before


def test_traces_end_with_their_episode() -> None:
    learner = Learner(1, QLearning(alpha=ALPHA, gamma=GAMMA, trace=1.0), Greedy(), 3)
    learner.decide(None, 0, 0, 0)
    learner.decide((0, 0, -1.0), 1, 0, 1)  # cut by the move limit: nobody says finish
    before = learner.values(0)[0]
    learner.decide(None, 5, 1, 0)
    learner.finish((5, 0, 100.0))
    assert learner.values(0)[0] == before


def test_a_restored_table_goes_on_bit_for_bit() -> None:
    settings, policy = QLearning(trace=0.9), Softmax(beta=1.0, repeat=0.5)
    whole, first = Learner(3, settings, policy, 4), Learner(3, settings, policy, 4)
    for episode in range(6):
        run(whole, episode)
    for episode in range(3):
        run(first, episode)
    second = Learner(3, settings, policy, 4)
    second.restore(first.snapshot())
    for episode in range(3, 6):
        run(second, episode)
    assert second.digest() == whole.digest()


def run(learner: Learner, episode: int) -> None:
    draws = np.random.default_rng(episode)
    previous = None
    for step in range(10):
        state = int(draws.integers(4))
        previous = (state, learner.decide(previous, state, episode, step), float(draws.normal()))
    assert previous is not None
    learner.finish(previous)


# -- going on with a move -----------------------------------------------------------------------------------------


def test_exploration_goes_on_with_a_move_less_and_less() -> None:
    policy = Softmax(repeat=0.8, repeat_fade=0.1)
    assert goes_on(policy, 0, 0.79) and not goes_on(policy, 0, 0.8)
    assert goes_on(policy, 10, 0.8 * math.exp(-1.0) - 1e-9) and not goes_on(policy, 10, 0.8 * math.exp(-1.0) + 1e-9)
    assert not goes_on(Softmax(), 0, 0.0) and not goes_on(Greedy(), 0, 0.0)
    assert faded(0.03, 100) == pytest.approx(math.exp(-3.0), rel=1e-15)
    assert faded(1e6, 1_000_000) == 0.0


def test_only_a_move_that_stays_at_its_depth_is_made_again() -> None:
    learner = Learner(9, QLearning(), EpsilonGreedy(epsilon=1.0, repeat=1.0, repeat_fade=0.0), 3)
    for before in range(9):
        actions = {learner.act(0, 0, step, before) for step in range(60)}
        assert (actions == {before}) == (before != 4)


def test_where_nothing_is_repeated_nothing_else_changes() -> None:
    plain, sticky = (Learner(9, QLearning(), Softmax(repeat=repeat), 3) for repeat in (0.0, 0.5))
    for step in range(40):
        assert plain.act(0, 0, step) == plain.act(0, 0, step, 2) == sticky.act(0, 0, step)
