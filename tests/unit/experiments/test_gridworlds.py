"""The grid worlds against the thesis's figures, and the learners against its Tables 4.1 and 4.2 (4.5.1)."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from experiments.reproduce.gridworlds import CLIFF, MAZES, GridWorld, Move, Training, greedy_path, train
from services.agent.learning import Learner
from services.wire.definition import TD_LEARNERS, EpsilonAnnealed, EpsilonGreedy, Policy, QLearning, Sarsa, Softmax

MOVES = {"N": Move.NORTH, "E": Move.EAST, "S": Move.SOUTH, "W": Move.WEST}
SHORTEST = {
    "narrow": ("SSEENEESSS", [7, 6, 2, 1, 4, 3, 9, 5, 6, 6]),
    "wide": ("SEENEESSSS", [7, 2, 1, 4, 3, 9, 5, 6, 6, 6]),
}
EDGE, SAFE = ["NEEEEEEEEES", "ENEEEEEEEES"], "NNNEEEEEEEEESSS"
TABLE_4_1 = {1: "E", 2: "E", 3: "E", 4: "N", 5: "S", 6: "S", 7: "S", 9: "E"}
TABLE_4_2_SAFE = {1: "E", 2: "N", 3: "E", 4: "S", 5: "S", 10: "N"}
SEEDS = range(4)
POLICIES: dict[str, Policy] = {
    **{f"mu {mu}": EpsilonAnnealed(mu=mu) for mu in (0.001, 0.01, 0.1, 1.0)},
    **{f"beta {beta}": Softmax(beta=beta, beta_per_episode=0.0) for beta in (1.0, 2.0, 5.0)},
}


def walk(world: GridWorld, moves: str) -> tuple[list[int], list[float], bool]:
    """Walk from S; return the states before the moves, the rewards and whether the episode is over."""
    states, rewards, ended = [world.reset()], [], False
    for move in moves:
        state, reward, ended = world.step(MOVES[move])
        states.append(state)
        rewards.append(reward)
    return states, rewards, ended


def moves_of(path: list[tuple[int, Move]]) -> str:
    return "".join(move.name[0] for _, move in path)


def best_moves(learner: Learner, states: dict[int, str]) -> dict[int, str]:
    return {state: Move(learner.best_action(state)).name[0] for state in states}


@pytest.mark.parametrize("maze", SHORTEST)
def test_maze_has_the_ten_move_path_of_table_4_1(maze: str) -> None:
    moves, states = SHORTEST[maze]
    walked, rewards, ended = walk(GridWorld(MAZES[maze]), moves)
    assert walked == [*states, 14]
    assert rewards == [-1.0] * 9 + [0.0]
    assert ended
    assert all(TABLE_4_1[state] == move for state, move in zip(states, moves, strict=True))


def test_cliff_has_the_returns_of_figure_4_16() -> None:
    for moves, total in [(EDGE[0], -10), (EDGE[1], -10), (SAFE, -14)]:
        states, rewards, ended = walk(GridWorld(CLIFF), moves)
        assert (states[0], states[-1], sum(rewards), ended) == (10, 14, total, True)
    assert walk(GridWorld(CLIFF), EDGE[1])[0] == [10, 12, 0, 8, 8, 8, 8, 8, 8, 8, 4, 14]


def test_a_fall_costs_100_and_ends_the_episode_and_reset_puts_back_on_s() -> None:
    world = GridWorld(CLIFF)
    assert walk(world, "EE")[1:] == ([-1.0, -100.0], True)
    assert world.square == "x"
    with pytest.raises(ValueError, match="expected a reset"):
        world.step(Move.NORTH)
    assert world.reset() == 10
    assert world.square == "S"


def test_a_move_into_a_wall_costs_1_and_stays() -> None:
    world = GridWorld(MAZES["wide"])
    states, rewards, ended = walk(world, "NEW")
    assert (states, rewards, ended, world.square) == ([7] * 4, [-1.0] * 3, False, "S")


def test_squares_are_told_apart_on_demand() -> None:
    states, _, _ = walk(GridWorld(CLIFF, sees="square"), SAFE)
    assert states == [30, 20, 10, *range(10), 19, 29, 39]


@pytest.mark.parametrize(
    ("layout", "message"),
    [
        ("SG\n.", "equally long"),
        ("SG?", "equally long"),
        ("", "equally long"),
        ("S..", "one S and one G"),
        ("SSG", "one S and one G"),
    ],
)
def test_a_wrong_layout_is_refused(layout: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        GridWorld(layout)


def test_an_unknown_move_is_refused() -> None:
    world = GridWorld(CLIFF)
    world.reset()
    with pytest.raises(ValueError, match="Move"):
        world.step(4)


def test_training_goes_on_where_it_stopped() -> None:
    def learner() -> Learner:
        return Learner(4, QLearning(alpha=0.1, gamma=0.9), EpsilonAnnealed(mu=0.1), 3)

    whole, parts = learner(), learner()
    at_once = train(GridWorld(MAZES["wide"]), whole, 30)
    first = train(GridWorld(MAZES["wide"]), parts, 10)
    rest = train(GridWorld(MAZES["wide"]), parts, 20, start_episode=10)
    assert np.concatenate([first.returns, rest.returns]).tolist() == at_once.returns.tolist()
    assert parts.digest() == whole.digest()
    assert whole.version == at_once.steps.sum()
    assert (at_once.returns == 1 - at_once.steps).all()


def test_an_episode_is_broken_off_at_the_limit_with_every_move_learnt() -> None:
    learner = Learner(4, Sarsa(), EpsilonAnnealed(mu=0.1), 3)
    training = train(GridWorld(MAZES["wide"]), learner, 4, step_limit=9)  # one less than the way out
    assert training.steps.tolist() == [9] * 4
    assert training.returns.tolist() == [-9.0] * 4
    assert learner.version == 36


@pytest.mark.parametrize("policy", POLICIES)
def test_sarsa_learns_the_maze_of_table_4_1(policy: str) -> None:
    learner = Learner(4, Sarsa(alpha=0.1, gamma=0.9), POLICIES[policy], 0)
    world = GridWorld(MAZES["wide"])
    train(world, learner, 500)
    assert best_moves(learner, TABLE_4_1) == TABLE_4_1
    assert moves_of(greedy_path(world, learner)) == SHORTEST["wide"][0]


def test_the_narrow_maze_is_learnt_once_its_squares_are_told_apart() -> None:
    # By walls alone it is not: state 6 is met below S and again before G, so turning back to S looks like winning.
    learner = Learner(4, Sarsa(alpha=0.1, gamma=0.9), POLICIES["beta 2.0"], 0)
    world = GridWorld(MAZES["narrow"], sees="square")
    train(world, learner, 500)
    assert moves_of(greedy_path(world, learner)) == SHORTEST["narrow"][0]


def walk_cliff(
    kind: Literal["q_learning", "sarsa"], seed: int, sees: Literal["walls", "square"]
) -> tuple[Learner, Training, str]:
    """Train with the thesis's parameters; return what was learnt, how it went and the greedy path."""
    learner = Learner(4, TD_LEARNERS[kind](alpha=0.1, gamma=0.1), EpsilonGreedy(epsilon=0.1), seed)
    world = GridWorld(CLIFF, sees)
    training = train(world, learner, 1000)
    return learner, training, moves_of(greedy_path(world, learner))


def test_on_the_cliff_sarsa_takes_the_safe_path_and_q_learning_falls_several_times_as_often() -> None:
    q_paths = []
    for seed in SEEDS:
        sarsa, careful, path = walk_cliff("sarsa", seed, "walls")
        assert path == SAFE
        assert best_moves(sarsa, TABLE_4_2_SAFE) == TABLE_4_2_SAFE
        assert 5 <= careful.falls.sum() <= 20  # thesis: 11
        q, bold, path = walk_cliff("q_learning", seed, "walls")
        assert best_moves(q, {4: "S", 12: "N"}) == {4: "S", 12: "N"}
        assert bold.falls.sum() >= 5 * careful.falls.sum()  # thesis: 167
        q_paths.append(path)
    # Seen by walls alone the cliff has a second self-consistent solution, one row above the edge (13 moves), and the
    # values differ by hundredths at gamma = 0.1: Q-learning wavers between the two, and never takes the safe path.
    assert SAFE not in q_paths
    assert any(path in EDGE for path in q_paths)


@pytest.mark.parametrize("seed", range(2))
def test_q_learning_takes_the_edge_of_the_cliff_once_squares_are_told_apart(seed: int) -> None:
    _, training, path = walk_cliff("q_learning", seed, "square")
    assert path in EDGE
    assert 150 <= training.falls.sum() <= 300
