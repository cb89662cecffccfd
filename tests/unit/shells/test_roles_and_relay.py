"""Who holds a role is heard, who comes second waits, and queries that wait for another service get their answer."""

from __future__ import annotations

from functools import partial
from typing import Any

import pytest
from msgspec.structs import replace

from services.agent.service import work
from services.bus.fake_bus import FakeBus
from services.bus.testing import FakeService
from services.wire.errors import RoleTakenError
from services.wire.keys import ACTION, CLAIM, CLASSIFY, POLICY, name_of
from services.wire.messages import Action, Classified, PolicyAnswer, Refusal


def test_as_long_as_nobody_held_the_role_everybody_is_heard_and_then_its_holder_alone(scene: Any) -> None:
    task = FakeService("task", zid="7a")
    heard: list[Action] = []
    task.claim()
    task.subscribe(ACTION, Action, heard.append, "agent")
    task.hear(ACTION, scene.actions[0])
    task.hold("agent", "a6")
    task.hear(ACTION, scene.actions[1])
    task.hear(ACTION, scene.actions[2], "a6")
    task.bus.token(task.keys.of(f"claim/agent/{1:020d}-a6"), here=False)
    task.hear(ACTION, scene.actions[3])
    task.settle()
    assert heard == [scene.actions[0], scene.actions[2]]
    assert task.refused == {"StrangerError": 2}


def test_who_comes_second_waits_says_so_and_takes_over(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = FakeBus()
    first, second = FakeService("agent", bus, zid="a1"), FakeService("agent", bus, zid="a2")
    first.claim()
    looked: list[float] = []

    def sleep(seconds: float) -> None:
        looked.append(seconds)
        if sum(looked) > 5.0:
            bus.tokens.clear()

    now = iter(range(1000))
    monkeypatch.setattr("services.bus.roles.time.sleep", sleep)
    monkeypatch.setattr("services.bus.roles.time.monotonic", lambda: next(now))
    second.claim()
    assert "waiting: agent: expected to be the only one in cell 'a', but 1 other has this role" in caplog.text
    assert [token for token in bus.tokens if "claim" in token] == [
        second.keys.of(f"claim/agent/{second.status().instance}")
    ]


def test_stopped_while_it_waits_for_its_role_it_ends_in_peace() -> None:
    bus = FakeBus()
    FakeService("agent", bus, zid="a1").claim()
    second = FakeService("agent", bus, zid="a2")
    second.stop()
    with pytest.raises(SystemExit) as ended:
        second.claim()
    assert ended.value.code == 0
    assert len(bus.tokens) == 1


def test_who_has_to_give_way_to_an_earlier_holder_stops() -> None:
    agent = FakeService("agent", zid="a2")
    agent.claim()
    agent.hold("agent", "a1")  # cut off from the router when we came, and back
    agent.loop()
    assert isinstance(agent.ousted, RoleTakenError)


def test_a_claim_without_a_time_is_an_early_one_and_no_fault() -> None:
    agent = FakeService("agent", zid="a2")
    agent.claim()
    agent.bus.token(agent.keys.of(name_of(CLAIM, service="agent", instance="-no-time")), here=True)
    agent.loop()
    assert isinstance(agent.ousted, RoleTakenError)


@pytest.mark.parametrize("stays", [True, False])
def test_a_claim_made_at_once_with_ours_counts_when_it_stays(stays: bool) -> None:
    agent = FakeService("agent", zid="a2")
    agent.claim()
    assert agent.status().instance.endswith("-a2")
    shortly_before = int(agent.status().instance.partition("-")[0]) - 10_000_000
    rival = agent.keys.of(name_of(CLAIM, service="agent", instance=f"{shortly_before:020d}-a1"))
    agent.bus.token(rival, here=True)
    agent.settle()
    assert agent.ousted is None
    if not stays:
        agent.bus.token(rival, here=False)
    agent.later(5.0, agent.stop)
    agent.loop()
    assert isinstance(agent.ousted, RoleTakenError) == stays


def test_a_query_that_needs_the_classifier_gets_its_answer_refusal_or_reason(scene: Any) -> None:
    agent = scene.service("agent")
    ft = f"{POLICY}?ft=1,0.2,-2,0,0.02,0"
    answers: list[Any] = []
    known = Classified(run=scene.run, decisions=0, states=1, state=0, match=0.9)

    def ask(answer: Any) -> None:
        agent.bus.answers[CLASSIFY] = answer
        answers.append(agent.answer_to(PolicyAnswer, ft))

    told = (known, Refusal(reason="bad_request", message="no direction"), None, replace(known, run="x-s0"))
    for number, answer in enumerate(told):
        agent.later(1.0 + number, partial(ask, answer))
    agent.run_for(work, 6.0)
    policy, refused, silent, foreign = answers
    assert isinstance(policy, PolicyAnswer) and (policy.state, policy.match) == (0, 0.9)
    assert isinstance(refused, Refusal) and (refused.reason, refused.message) == ("bad_request", "no direction")
    assert isinstance(silent, Refusal) and "expected a good answer within 1 s" in silent.message
    assert isinstance(foreign, Refusal) and "one of x-s0" in foreign.message
