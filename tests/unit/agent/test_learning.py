"""The learner: updates worked by hand, order of learning and acting, exact snapshots, refusals."""

from __future__ import annotations

import hashlib
import math
import struct
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.agent.learning import MAX_STATES, Learner
from services.agent.policies import probabilities
from services.wire.definition import TD_LEARNERS, EpsilonGreedy, Greedy, Policy, Softmax

Kind = Literal["q_learning", "sarsa"]
KINDS: list[Kind] = ["q_learning", "sarsa"]
SOFTMAX = Softmax(beta=1.0, beta_per_episode=0.05)


def make(kind: Kind = "q_learning", policy: Policy = SOFTMAX, actions: int = 3, seed: int = 5) -> Learner:
    return Learner(actions, TD_LEARNERS[kind](alpha=0.5, gamma=0.9), policy, seed)


def live(learner: Learner, first: int, episodes: int) -> list[int]:
    """Act for some episodes in a made-up world of 7 states; return the actions."""
    actions = []
    for episode in range(first, first + episodes):
        previous, state = None, episode % 7
        for step in range(8):
            action = learner.decide(previous, state, episode, step)
            actions.append(action)
            previous = (state, action, -1.0 - 0.25 * ((state + action) % 3))
            state = (3 * state + action + 1) % 7
        learner.finish(previous or (0, 0, 0.0))
    return actions


@st.composite
def transitions(draw: st.DrawFn) -> tuple[int, int, float, int | None, int]:
    """Draw the arguments of an update of a learner of 3 actions."""
    next_state = draw(st.none() | st.integers(0, 40))
    reward = draw(st.floats(-1e3, 1e3))
    return draw(st.integers(0, 40)), draw(st.integers(0, 2)), reward, next_state, draw(st.integers(0, 2))


def test_q_learning_is_equation_4_4() -> None:
    learner = make("q_learning")
    learner.update(1, 0, 4.0, None, None)  # 0 + 0.5 (4 - 0)
    learner.update(1, 2, -2.0, None, None)  # 0 + 0.5 (-2 - 0)
    learner.update(0, 1, 1.0, 1, None)  # 0 + 0.5 (1 + 0.9 * 2 - 0)
    learner.update(0, 1, -3.0, 1, 2)  # 1.4 + 0.5 (-3 + 0.9 * 2 - 1.4): the next action is ignored
    assert learner.q == pytest.approx(np.array([[0, 0.1, 0], [2, 0, -1]]), abs=1e-15)
    assert learner.visits.tolist() == [[0, 2, 0], [1, 0, 1]]


def test_sarsa_is_equation_4_5() -> None:
    learner = make("sarsa")
    learner.update(1, 0, 4.0, None, None)
    learner.update(1, 2, -2.0, None, None)
    learner.update(0, 1, 1.0, 1, 2)  # 0 + 0.5 (1 + 0.9 * -1 - 0)
    learner.update(0, 1, -3.0, 1, 0)  # 0.05 + 0.5 (-3 + 0.9 * 2 - 0.05)
    assert learner.q == pytest.approx(np.array([[0, -0.575, 0], [2, 0, -1]]), abs=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_an_unseen_next_state_is_worth_0_and_gets_no_row(kind: Kind) -> None:
    learner = make(kind)
    learner.update(2, 1, -1.0, 9, 0)
    assert learner.q.tolist() == [[0, 0, 0], [0, 0, 0], [0, -0.5, 0]]
    assert learner.values(2).tolist() == [0, -0.5, 0]
    assert learner.values(9).tolist() == [0, 0, 0]
    assert (learner.states, learner.actions, learner.version) == (3, 3, 1)


def test_a_staying_move_learns_from_the_value_before() -> None:
    learner = make("q_learning", actions=1)
    learner.update(0, 0, 2.0, 0, None)  # 0 + 0.5 (2 + 0 - 0)
    learner.update(0, 0, 2.0, 0, None)  # 1 + 0.5 (2 + 0.9 * 1 - 1)
    assert learner.q.tolist() == [[1.95]]


def test_q_learning_learns_before_it_acts() -> None:
    learner = make("q_learning", Greedy(), actions=2)
    learner.update(0, 0, 1.0, None, None)
    assert learner.decide((0, 0, -9.0), 0, 0, 1) == 1  # -9 has made action 0 the worse one
    assert learner.q[0, 0] == pytest.approx(0.5 + 0.5 * (-9 + 0.9 * 0.5 - 0.5))


def test_sarsa_acts_before_it_learns() -> None:
    learner = make("sarsa", Greedy(), actions=2)
    learner.update(0, 0, 1.0, None, None)
    assert learner.decide((0, 0, -9.0), 0, 0, 1) == 0  # chosen by the values before -9 was learnt
    assert learner.q[0, 0] == pytest.approx(0.5 + 0.5 * (-9 + 0.9 * 0.5 - 0.5))


@pytest.mark.parametrize("kind", KINDS)
def test_deciding_is_acting_and_updating(kind: Kind) -> None:
    whole, parts = make(kind), make(kind)
    live(whole, 0, 4)
    live(parts, 0, 4)
    chosen = whole.decide((3, 1, -2.0), 6, 4, 8)
    if kind == "q_learning":
        parts.update(3, 1, -2.0, 6, None)
        assert parts.act(6, 4, 8) == chosen
    else:
        assert parts.act(6, 4, 8) == chosen
        parts.update(3, 1, -2.0, 6, chosen)
    assert parts.digest() == whole.digest()


@pytest.mark.parametrize("kind", KINDS)
def test_the_first_decision_of_an_episode_learns_nothing(kind: Kind) -> None:
    learner = make(kind)
    assert learner.decide(None, 4, 0, 0) == learner.act(4, 0, 0)
    assert (learner.version, learner.states) == (0, 0)


@pytest.mark.parametrize("policy", [Greedy(), EpsilonGreedy(epsilon=0.3), SOFTMAX])
def test_acts_as_often_as_the_policy_says(policy: Policy) -> None:
    learner, draws = make(policy=policy, actions=4), 4000
    for action, reward in enumerate([1.0, 2.0, -1.0, 2.0]):
        learner.update(0, action, reward, None, None)
    counts = np.bincount([learner.act(0, 3, step) for step in range(draws)], minlength=4)
    expected = probabilities(learner.q[0], policy, 3)
    assert np.abs(counts / draws - expected).max() <= 4 * np.sqrt(expected * (1 - expected) / draws).max()


def test_an_unseen_state_is_acted_in_evenly() -> None:
    counts = np.bincount([make(policy=Greedy()).act(9, 0, step) for step in range(3000)], minlength=3)
    assert np.abs(counts / 3000 - 1 / 3).max() <= 4 * math.sqrt(2 / 9 / 3000)


@pytest.mark.parametrize("kind", KINDS)
def test_acting_depends_on_table_seed_episode_and_step_only(kind: Kind) -> None:
    asked, fresh = make(kind), make(kind)
    times = [(state, episode, step) for state in range(9) for episode in range(3) for step in range(3)]
    live(asked, 0, 5)
    answers = {time: asked.act(*time) for time in times}
    live(fresh, 0, 5)
    assert {time: fresh.act(*time) for time in reversed(times)} == answers
    assert asked.digest() == fresh.digest()


def test_another_seed_acts_otherwise() -> None:
    assert live(make(seed=5), 0, 5) != live(make(seed=6), 0, 5)


def test_the_best_action_is_the_lowest_of_equals() -> None:
    learner = make()
    learner.update(0, 2, 1.0, None, None)
    learner.update(0, 1, 1.0, None, None)
    assert learner.best_action(0) == 1
    assert learner.best_action(77) == 0


@given(st.lists(transitions(), max_size=30), st.sampled_from(KINDS))
def test_table_ends_with_the_highest_updated_state_and_counts_every_update(
    history: list[tuple[int, int, float, int | None, int]], kind: Kind
) -> None:
    learner = make(kind)
    for transition in history:
        learner.update(*transition)
    assert learner.states == max((state + 1 for state, *_ in history), default=0)
    assert learner.version == len(history) == learner.visits.sum()
    assert learner.q.shape == learner.visits.shape == (learner.states, 3)
    assert not learner.q[learner.visits == 0].any()
    copy = make(kind)
    copy.restore(learner.snapshot())
    assert (copy.digest(), copy.snapshot()) == (learner.digest(), learner.snapshot())


@pytest.mark.parametrize("kind", KINDS)
def test_a_restored_learner_goes_on_as_if_never_stopped(kind: Kind) -> None:
    whole, first, second = make(kind), make(kind), make(kind)
    actions = live(whole, 0, 12)
    before = live(first, 0, 5)
    live(second, 40, 3)  # forgotten on restore
    second.restore(first.snapshot())
    assert before + live(second, 5, 7) == actions
    assert second.digest() == whole.digest()
    assert second.version == whole.version == 12 * 8


def test_snapshot_and_copies_are_cut_off_from_the_table() -> None:
    learner = make()
    learner.update(0, 0, 1.0, None, None)
    snapshot, digest = learner.snapshot(), learner.digest()
    learner.q[0, 0] = 9.0
    learner.visits[0, 0] = 9
    learner.values(0)[0] = 9.0
    learner.values(7)[0] = 9.0
    assert learner.digest() == digest
    assert not learner.values(8).any()
    learner.update(0, 0, 1.0, None, None)
    assert learner.digest() != digest
    learner.restore(snapshot)
    learner.update(1, 0, 1.0, None, None)  # the restored table can be written to and grow
    assert learner.q[:, 0].tolist() == [0.5, 0.5]


def test_the_digest_is_that_of_shape_values_and_visits() -> None:
    learner = make()
    learner.update(1, 2, -1.0, None, None)
    content = struct.pack("<2q6d6q", 2, 3, 0, 0, 0, 0, 0, -0.5, 0, 0, 0, 0, 0, 1)
    assert learner.digest() == hashlib.sha256(content).hexdigest()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-1, 0, 0.0, None, None), "state: expected 0 to"),
        ((MAX_STATES, 0, 0.0, None, None), "state: expected 0 to"),
        ((0, 3, 0.0, None, None), "action: expected 0 to 2, got 3"),
        ((0, -1, 0.0, None, None), "action: expected 0 to 2, got -1"),
        ((0, 0, math.nan, None, None), "reward in state 0: expected a finite number, got nan"),
        ((0, 0, -math.inf, 1, 0), "reward in state 0: expected a finite number, got -inf"),
        ((0, 0, 0.0, -2, 0), "state: expected 0 to .* got -2"),
        ((1, 0, 1.7e308, 3, 0), "value of state 1, action 0: expected a finite number, got inf"),
    ],
)
def test_a_refused_update_changes_nothing(
    kind: Kind, arguments: tuple[int, int, float, int | None, int | None], message: str
) -> None:
    learner = make(kind)
    learner.update(1, 0, -1.7e308, None, None)
    learner.update(3, 0, 1.7e308, None, None)
    digest = learner.digest()
    with pytest.raises(ValueError, match=message):
        learner.update(*arguments)
    assert (learner.digest(), learner.version) == (digest, 2)


@pytest.mark.parametrize(
    ("next_action", "message"), [(None, "SARSA: expected the action"), (3, "next action: expected")]
)
def test_sarsa_needs_the_next_action(next_action: int | None, message: str) -> None:
    learner = make("sarsa")
    with pytest.raises(ValueError, match=message):
        learner.update(0, 0, 1.0, 1, next_action)
    assert learner.version == 0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("state", "episode", "step"), [(-1, 0, 0), (0, -1, 0), (0, 0, -1), (MAX_STATES, 0, 0)])
def test_a_refused_decision_learns_nothing(kind: Kind, state: int, episode: int, step: int) -> None:
    for policy in (Greedy(), SOFTMAX):
        learner = make(kind, policy)
        learner.update(0, 0, 1.0, None, None)
        with pytest.raises(ValueError, match="expected 0"):
            learner.decide((0, 0, 1.0), state, episode, step)
        assert learner.version == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"actions": 4}, "expected 3 actions, got 4"),
        ({"actions": True}, "expected actions to be a whole number"),
        ({"states": -1}, "expected states to be a whole number"),
        ({"states": 3}, "expected q to be 72 bytes, got 48"),
        ({"states": MAX_STATES + 1}, "at most"),
        ({"version": 3}, "add up to version 3"),
        ({"version": "2"}, "expected version to be a whole number"),
        ({"q": b""}, "expected q to be 48 bytes, got 0"),
        ({"q": [0.0] * 6}, "expected q to be 48 bytes, got list"),
        ({"q": np.array([0, 0, 0, math.nan, 0, 0]).tobytes()}, "finite"),
        ({"visits": b"\0" * 40}, "expected visits to be 48 bytes, got 40"),
        ({"visits": np.array([3, 0, 0, -1, 0, 0]).tobytes()}, "visits of 0 or more"),
        ({"visits": np.array([2, 0, 0, 0, 0, 0]).tobytes()}, "some in the last of 2 states"),
        ({"extra": 1}, "expected the fields"),
    ],
)
def test_a_refused_snapshot_changes_nothing(changes: dict[str, object], message: str) -> None:
    learner = make()
    learner.update(0, 0, 1.0, None, None)
    learner.update(1, 2, 1.0, None, None)
    digest = learner.digest()
    with pytest.raises(ValueError, match=message):
        learner.restore({**learner.snapshot(), **changes})
    assert (learner.digest(), learner.version) == (digest, 2)


def test_a_snapshot_with_a_missing_field_is_refused() -> None:
    snapshot = make().snapshot()
    del snapshot["visits"]
    with pytest.raises(ValueError, match="expected the fields"):
        make().restore(snapshot)


@pytest.mark.parametrize(("actions", "seed"), [(0, 1), (3, -1), (3, 2**63)])
def test_a_learner_without_actions_or_seed_is_refused(actions: int, seed: int) -> None:
    with pytest.raises(ValueError, match="expected"):
        make(actions=actions, seed=seed)
