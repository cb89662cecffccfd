"""Policies that learn nothing, behind the agent's fold: force and torque to an action, and to a move."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from services.agent.fixed import FixedAction, FixedMove
from services.agent.fold import AgentFold
from services.rules import plugins
from services.rules.bounds import Bounds
from services.rules.plugins import PluginError
from services.rules.wrench import Wrench
from services.wire.actions import INSERT, Increment
from services.wire.definition import Continuous, Definition, Greedy, Moves, Plugin, Setting, Unclassified
from services.wire.errors import UnusableError
from services.wire.messages import Force, Reward, State

RUN = "test-s0"
BOUNDED = Moves(continuous=Continuous(x_mm=0.2, z_mm=0.2))
NO_NM = (0.0, 0.0, 0.0)


class Flee(FixedAction):
    """Away from a force along X, else on."""

    def action(self, felt: Wrench) -> int:
        force_x = felt.force_n[0]
        return INSERT if abs(force_x) < 0.3 else 0 if force_x > 0 else 1


class GiveWay(FixedMove):
    """As far as a force along X says."""

    def move(self, felt: Wrench) -> Increment:
        return Increment(dx_mm=0.1 * felt.force_n[0])


class Picky(FixedMove):
    """Wants a gain."""

    def __init__(self, bounds: Bounds, settings: Mapping[str, Setting], seed: int) -> None:
        super().__init__(bounds, {}, seed)
        if "gain" not in settings:
            raise ValueError("settings: expected gain, got none")

    def move(self, felt: Wrench) -> Increment:
        return Increment()


class Point:
    """An entry point of a class that is here already."""

    def __init__(self, kind: type) -> None:
        self.value, self._kind = kind.__name__, kind

    def load(self) -> type:
        return self._kind


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    points = {"flee": Point(Flee), "give-way": Point(GiveWay), "picky": Point(Picky)}
    monkeypatch.setattr(plugins, "installed", lambda group: points)


def definition(name: str, moves: Moves = BOUNDED) -> Definition:
    return Definition(name="test", moves=moves, classifier=Unclassified(), learner=Plugin(name=name), policy=Greedy())


def fold(name: str) -> AgentFold:
    return AgentFold(definition(name), RUN, 0)


def place(decision: int) -> dict[str, Any]:
    return {"run": RUN, "episode": 0, "step": decision, "decision": decision}


def felt(decision: int, force_n: Force) -> State:
    return State(**place(decision), state=0, states=1, match=1.0, force_n=force_n, torque_nm=NO_NM)


def test_a_rule_answers_numbers_of_moves_and_learns_nothing() -> None:
    agent = fold("flee")
    digest = agent.learner.digest()
    for decision, (force_x, expected) in enumerate([(0.1, INSERT), (2.0, 0), (-2.0, 1)]):
        action = agent.decide(felt(decision, (force_x, 0.0, -1.0)))
        assert (action.action, action.increment, action.policy_version) == (expected, None, 0)
        agent.reward(Reward(**place(decision), reward=-1.0, terminal=None))
    assert agent.learner.digest() == digest
    opinion = agent.opinion(0, (2.0, 0.0, 0.0), NO_NM)
    assert opinion is not None and opinion.chances.argmax() == 0 and agent.proposal(0, (2.0, 0.0, 0.0), NO_NM) is None


def test_a_rule_answers_moves_which_are_rounded_towards_zero() -> None:
    agent = fold("give-way")
    actions = [agent.decide(felt(0, (0.123456, 0.0, 0.0)))]
    agent.reward(Reward(**place(0), reward=-1.0, terminal=None))
    actions.append(agent.decide(felt(1, (-1.99999, 0.0, 0.0))))
    assert [action.increment for action in actions] == [Increment(dx_mm=0.0123), Increment(dx_mm=-0.1999)]
    assert [action.action for action in actions] == [0, 0] and agent.version == 0
    proposal = agent.proposal(0, (1.0, 0.0, 0.0), NO_NM)
    assert proposal is not None and proposal.increment == Increment(dx_mm=0.1)
    assert agent.opinion(0, (1.0, 0.0, 0.0), NO_NM) is None


def test_a_proposal_out_of_bounds_is_refused_loudly() -> None:
    with pytest.raises(UnusableError, match=r"decision 0: proposed move: dx_mm: expected -0.2 to 0.2, .* got 0.3"):
        fold("give-way").decide(felt(0, (3.0, 0.0, 0.0)))


def test_a_policy_without_bounds_or_with_settings_it_refuses_is_refused_before_anything_starts() -> None:
    with pytest.raises(PluginError, match=r"'give-way' proposes moves .*: expected some in moves\.continuous"):
        plugins.check(definition("give-way", Moves()))
    with pytest.raises(PluginError, match="'picky': settings: ValueError: settings: expected gain, got none"):
        plugins.check(definition("picky"))
    plugins.check(definition("give-way"))


def test_memory_is_nothing_and_fits_only_itself() -> None:
    agent, other = fold("flee"), fold("flee")
    other.restore(agent.snapshot())
    with pytest.raises(ValueError, match="learns nothing"):
        agent.learner.restore({"states": 0, "version": 1})
    assert fold("give-way").learner.digest() != agent.learner.digest() == other.learner.digest()
