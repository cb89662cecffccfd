"""What a cell's agent says of a learner that proposes moves when it is asked what it would do."""

from __future__ import annotations

from functools import partial
from typing import Any

import pytest

from services.agent.fold import AgentFold
from services.agent.service import work
from services.rules.plugins import proposes
from services.wire.definition import Definition
from services.wire.definition_file import load
from services.wire.keys import CLASSIFY, POLICY, Q_TABLE, REWARD, STATE
from services.wire.messages import Action, Classified, PolicyAnswer, QTable, Refusal
from tests.unit.shells.conftest import SEED, Scene

FORCE, TORQUE = (1.0, 0.2, -2.0), (0.0, 0.02, 0.0)
FT = f"{POLICY}?ft=1,0.2,-2,0,0.02,0"
DECISIONS = 10


def definition(*more: str) -> Definition:
    return load(
        "suite-round",
        [
            'classifier={kind="none"}',
            'learner={kind="plugin", name="srv"}',
            'policy={kind="greedy"}',
            "moves.continuous={x_mm=0.2, y_mm=0.1, z_mm=0.2, rx_deg=0.2}",
            *more,
        ],
    )


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Return a run whose learner answers moves."""
    return Scene(definition())


def asked(scene: Any, *selectors: str) -> tuple[list[Any], list[Action]]:
    """Return what an agent that has learnt a while answers, and what it did before and after it was asked."""
    agent = scene.service("agent")
    agent.bus.answers[CLASSIFY] = Classified(run=scene.run, decisions=DECISIONS, states=1, state=0, match=1.0)
    answers: list[Any] = []
    for decision in range(DECISIONS + 5):
        at = 0.1 * (decision + 1) + (1.0 if decision >= DECISIONS else 0.0)
        agent.later(at, partial(agent.hear, STATE, scene.states[decision], scene.sessions["classifier"]))
        agent.later(at + 0.01, partial(agent.hear, REWARD, scene.rewards[decision], scene.sessions["task"]))
    kinds = {Q_TABLE: QTable}
    agent.later(1.5, lambda: answers.extend(agent.answer_to(kinds.get(text, PolicyAnswer), text) for text in selectors))
    agent.run_for(work, 4.0)
    return answers, agent.published(Action)


def test_at_a_sample_it_says_the_move_its_spread_and_what_it_is_thought_to_earn(scene: Scene) -> None:
    ((answer,), _) = asked(scene, FT)
    fold = AgentFold(scene.definition, scene.run, SEED, ())
    for state, reward in zip(scene.states[:DECISIONS], scene.rewards[:DECISIONS], strict=True):
        fold.decide(state)
        fold.reward(reward)
    expected = fold.proposal(0, FORCE, TORQUE)
    assert expected is not None and isinstance(answer, PolicyAnswer)
    assert (answer.increment, answer.spread, answer.worth) == (expected.increment, expected.spread, expected.worth)
    assert answer.policy_version == fold.version == DECISIONS
    assert answer.known and (answer.state, answer.match) == (0, 1.0)
    assert not (answer.actions or answer.values or answer.probabilities), "no list is chosen from"
    assert answer.increment is not None and answer.spread is not None
    bounds = (0.2, 0.1, 0.2, 0.2, 0.0, 0.0)
    assert all(abs(moved) <= most for moved, most in zip(answer.increment, bounds, strict=True))
    assert answer.increment[2] >= 0.0 and answer.spread[4:] == (0.0, 0.0), "there is no way back, and no turn about Y"
    assert answer.spread[0] == pytest.approx(2.0 * answer.spread[1]), "as parts of the bounds all spread alike"


def test_asked_it_goes_on_as_if_nobody_had_asked(scene: Scene) -> None:
    assert asked(scene, FT, FT, Q_TABLE)[1] == asked(scene)[1] == scene.actions[: DECISIONS + 5]
    assert all(action.increment is not None for action in scene.actions)


def test_a_state_alone_is_refused_and_there_is_no_table(scene: Scene) -> None:
    (refused, table), _ = asked(scene, f"{POLICY}?state=0", Q_TABLE)
    assert isinstance(refused, Refusal) and refused.reason == "bad_request"
    assert "expected agent/policy?ft=..., as moves are proposed by what is felt, got a state" in refused.message
    assert isinstance(table, QTable) and table.partial and not (table.actions or table.q)
    assert table.decisions == DECISIONS


def test_what_nobody_can_feel_is_refused_in_words(scene: Scene) -> None:
    (refused,), _ = asked(scene, f"{POLICY}?ft=1,0.2,-2,99999,0.02,0")
    assert isinstance(refused, Refusal) and refused.reason == "bad_request"
    assert refused.message.startswith("ft: force and torque: expected numbers within 1e+06")


def test_before_anything_is_learnt_it_says_so() -> None:
    scene = Scene(definition())
    agent = scene.service("agent")
    agent.bus.answers[CLASSIFY] = Classified(run=scene.run, decisions=0, states=1, state=0, match=1.0)
    answers: list[Any] = []
    agent.later(1.0, lambda: answers.append(agent.answer_to(PolicyAnswer, FT)))
    agent.run_for(work, 2.0)
    (answer,) = answers
    assert isinstance(answer, PolicyAnswer) and not answer.known and answer.policy_version == 0
    assert proposes(AgentFold(scene.definition, scene.run, SEED, ()).learner)
