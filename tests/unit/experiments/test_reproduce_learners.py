"""The chapter on learners: its runs go through the service's learner, and its checks tell right from wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from experiments.reproduce import learner_figures
from experiments.reproduce.cliff_gym import CliffWalking
from experiments.reproduce.gridworlds import greedy_path, train
from experiments.reproduce.learner_cliff import OPTIMAL_PATHS, SAFE_PATH, path_name, stable_from
from experiments.reproduce.learner_maze import OPTIMAL, SHORTEST, THESIS, right
from experiments.reproduce.learner_parts import most
from experiments.reproduce.learner_runs import KINDS, POLICIES, Run, learn
from services.agent.learning import Learner
from services.wire.definition import EpsilonGreedy, QLearning

MAZE = Run("maze wide", "walls", "sarsa", "μ = 0.1", 0.1, 0.9, 200, 0)


def test_a_run_is_a_function_of_its_key() -> None:
    once, again = learn(replace(MAZE, episodes=20)), learn(replace(MAZE, episodes=20))
    assert once == again
    assert learn(replace(MAZE, episodes=20, seed=1)).returns != once.returns
    assert len(once.returns) == 20


def test_the_open_maze_is_learnt_as_in_table_4_1() -> None:
    learnt = learn(MAZE)
    assert right(learnt) == len(OPTIMAL) == 8
    assert learnt.path == SHORTEST["wide"]
    assert learnt.greedy_return == -9.0
    assert learnt.falls == []


def test_the_corridor_maze_is_not() -> None:
    learnt = learn(replace(MAZE, world="maze narrow", policy="β = 2", episodes=100))
    assert right(learnt) < 8
    assert len(learnt.path) == 100
    apart = learn(replace(MAZE, world="maze narrow", sees="square", kind="q_learning", policy="β = 2"))
    assert apart.path == SHORTEST["narrow"]
    assert apart.best == ""


def test_the_printed_tables_agree_with_their_last_column() -> None:
    for kind in KINDS:
        assert len(THESIS[kind]) == len(POLICIES)
        for column in THESIS[kind]:
            assert len(column) == 16
            assert {state: column[state] for state in OPTIMAL} == OPTIMAL


def test_sarsa_at_the_cliff() -> None:
    learnt = learn(Run("cliff", "walls", "sarsa", "ε = 0.1", 0.1, 0.1, 1000, 3))
    assert (learnt.path, learnt.greedy_return) == (SAFE_PATH, -14.0)
    assert 5 <= len(learnt.falls) <= 20  # thesis: 11
    assert all(learnt.returns[episode] <= -100 for episode in learnt.falls)


def test_paths_by_name() -> None:
    assert {path_name(path) for path in OPTIMAL_PATHS} == {"the edge, 11 moves"}
    assert path_name(SAFE_PATH) == "the safe path, 15 moves"
    assert path_name("NEENEEEEEEESS") == "another, 13 moves"
    assert path_name("EW" * 50) == "walks to and fro"


def test_stable_is_the_first_window_as_good_as_late_ones() -> None:
    assert stable_from([-100.0] * 40 + [-10.0] * 160) == 40
    assert stable_from([-10.0] * 200) == 0


def test_the_most_frequent_move_shows_its_share() -> None:
    assert most("EEE") == "E"
    assert most("EEN") == "E 2/3"


@pytest.mark.parametrize("mu", learner_figures.MUS)
def test_the_drawn_epsilon_is_that_of_equation_4_2(mu: float) -> None:
    curve = [learner_figures.epsilon(mu, episode) for episode in (0, 1, 500)]
    assert np.allclose(curve, [1.0, 1 / (mu + 1), 1 / (500 * mu + 1)], rtol=1e-12)


def test_cliff_walking_is_the_textbooks() -> None:
    world = CliffWalking()
    assert world.reset() == 36
    assert world.step(1) == (36, -100.0, False)  # east over the edge: back at the start, and it goes on
    assert world.step(0) == (24, -1.0, False)
    assert [world.step(1)[0] for _ in range(11)] == list(range(25, 36))
    assert world.step(2) == (47, -1.0, True)


def test_q_learning_solves_cliff_walking() -> None:
    learner = Learner(4, QLearning(alpha=0.5, gamma=1.0), EpsilonGreedy(epsilon=0.1), 0)
    world = CliffWalking()
    training = train(world, learner, 300)
    assert len(greedy_path(world, learner)) == 13
    assert not training.falls.any()
    assert training.returns.min() < -100
