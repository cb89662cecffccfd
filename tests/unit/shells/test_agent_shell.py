"""The agent's shell without a process: whatever comes, in whatever order, its memory is the fold of the run."""

from __future__ import annotations

from functools import partial
from typing import Any

import pytest
from msgspec.structs import replace

from services.agent.service import work
from services.bus.testing import FakeService
from services.bus.worker import CHECKPOINT_EVERY
from services.wire.keys import EXPERIMENT, POLICY, Q_TABLE, REWARD, STATE, TASK_STEPS
from services.wire.messages import Action, Checkpoint, PolicyAnswer, QTable, Refusal


def play(scene: Any, service: FakeService, first: int, last: int) -> None:
    """Say what classifier and task would say of some decisions, a tenth of a second apart."""
    for decision in range(first, last):
        service.later(0.1 * (decision - first + 1), partial(say, scene, service, decision))


def say(scene: Any, service: FakeService, decision: int) -> None:
    service.hear(STATE, scene.states[decision], scene.sessions["classifier"])
    service.hear(REWARD, scene.rewards[decision], scene.sessions["task"])


def test_it_acts_as_the_fold_does(scene: Any) -> None:
    agent = scene.service("agent")
    play(scene, agent, 0, 20)
    agent.run_for(work, 3.0)
    assert agent.published(Action) == scene.actions[:20]
    assert not agent.refused
    assert "treenail/a/alive/agent" in agent.bus.tokens


def test_a_message_seen_before_is_answered_again_and_changes_nothing(scene: Any) -> None:
    agent = scene.service("agent")
    play(scene, agent, 0, 5)
    agent.later(1.0, lambda: say(scene, agent, 4))
    agent.later(1.1, lambda: agent.hear(STATE, scene.states[4], scene.sessions["classifier"]))
    agent.later(1.2, lambda: say(scene, agent, 5))
    agent.run_for(work, 2.0)
    acted = agent.published(Action)
    assert acted == [*scene.actions[:5], scene.actions[4], scene.actions[4], scene.actions[5]]


def test_what_was_missed_is_fetched_from_task_and_journal(scene: Any) -> None:
    agent = scene.service("agent")
    play(scene, agent, 0, 2)
    agent.later(0.9, lambda: scene.stand(agent.bus, 6, 17))
    agent.later(1.0, lambda: say(scene, agent, 17))
    agent.run_for(work, 2.0)
    assert agent.published(Action)[2:] == [scene.actions[17]]


def test_a_gap_that_cannot_be_filled_is_refused_and_the_rest_goes_on(scene: Any) -> None:
    agent = scene.service("agent")
    play(scene, agent, 0, 2)
    agent.later(0.9, lambda: agent.bus.answers.pop(TASK_STEPS))
    agent.later(1.0, lambda: agent.hear(STATE, scene.states[9], scene.sessions["classifier"]))
    agent.later(1.1, lambda: say(scene, agent, 2))
    agent.run_for(work, 2.0)
    assert agent.refused["NoAnswerError"] == 1
    assert agent.published(Action) == scene.actions[:3]


def test_the_state_after_a_reward_that_is_late_waits_for_it(scene: Any) -> None:
    agent = scene.service("agent")
    play(scene, agent, 0, 1)
    agent.later(0.5, lambda: agent.hear(STATE, scene.states[1], scene.sessions["classifier"]))
    agent.later(0.6, lambda: agent.hear(STATE, scene.states[2], scene.sessions["classifier"]))
    agent.later(0.7, lambda: agent.hear(REWARD, scene.rewards[1], scene.sessions["task"]))
    agent.run_for(work, 0.65)
    assert agent.published(Action) == scene.actions[:2]


def test_another_run_and_another_sender_are_refused(scene: Any) -> None:
    agent = scene.service("agent")
    play(scene, agent, 0, 3)
    agent.later(1.0, lambda: agent.hear(STATE, replace(scene.states[3], run="other-s0"), scene.sessions["classifier"]))
    agent.later(1.1, lambda: agent.hear(STATE, scene.states[3]))
    agent.later(1.2, lambda: agent.hear(STATE, scene.states[3], scene.sessions["task"]))
    agent.later(1.3, lambda: agent.hear_raw(STATE, b"\xc1", "text/plain", scene.sessions["classifier"]))
    agent.run_for(work, 2.0)
    assert agent.refused == {"ForeignRunError": 1, "StrangerError": 2, "WrongTypeError": 1}
    assert agent.published(Action) == scene.actions[:3]


def test_it_starts_again_from_checkpoint_and_journal(scene: Any) -> None:
    bus = scene.bus()
    first = scene.service("agent", bus)
    half = sum(len(entry.steps) for entry in scene.journal[: CHECKPOINT_EVERY + 3])
    play(scene, first, 0, half)
    first.run_for(work, 30.0)
    assert {checkpoint.episode for checkpoint in first.published(Checkpoint)} == {CHECKPOINT_EVERY}
    scene.stand(bus, CHECKPOINT_EVERY + 3)
    for entry in scene.journal[:CHECKPOINT_EVERY]:  # the journal before the checkpoint is not needed
        bus.stored.pop(scene.keys.journal(scene.run, entry.episode))
    bus.tokens.clear()
    again = scene.service("agent", bus)
    said = len(again.published(Action))
    play(scene, again, half, half + 4)
    again.run_for(work, 2.0)
    assert again.published(Action)[said:] == scene.actions[half : half + 4]


def test_with_a_journal_that_has_lost_its_beginning_it_waits_until_that_is_back(scene: Any) -> None:
    bus = scene.bus(episodes_done=5)
    key, next_one = scene.keys.journal(scene.run, 0), sum(len(entry.steps) for entry in scene.journal[:5])
    lost = bus.stored.pop(key)
    agent = scene.service("agent", bus)
    phases: list[str] = []
    agent.later(1.0, lambda: phases.append(agent.phase))
    agent.later(2.0, lambda: bus.stored.update({key: lost}))
    agent.later(10.0, lambda: say(scene, agent, next_one))
    agent.run_for(work, 12.0)
    (phase,) = phases
    assert phase.startswith("waiting for store (neither checkpoint nor journal has decisions 0 to ")
    assert agent.phase == "running"
    assert agent.published(Action) == [scene.actions[next_one]]


def test_a_checkpoint_that_cannot_be_gone_on_with_is_passed_over(scene: Any, caplog: pytest.LogCaptureFixture) -> None:
    bus = scene.bus(episodes_done=5)
    next_one = sum(len(entry.steps) for entry in scene.journal[:5])
    agent = scene.service("agent", bus)
    useless = Checkpoint(
        run=scene.run,
        service="agent",
        episode=1,
        decisions=3,
        contract_sha256=agent.contract,
        snapshot={"q": b"\xff" * 7, "states": 3},
    )
    agent.store(scene.keys.checkpoint_latest(scene.run, "agent"), useless)
    agent.later(10.0, lambda: say(scene, agent, next_one))
    agent.run_for(work, 12.0)
    assert "checkpoint before episode 1 is passed over" in caplog.text
    assert agent.published(Action) == [scene.actions[next_one]]


def test_it_waits_for_a_store_that_knows_the_run_and_says_so(scene: Any) -> None:
    agent = scene.service("agent")
    agent.bus.store_answers = False
    phases: list[str] = []
    agent.later(1.0, lambda: phases.append(agent.phase))
    agent.later(2.0, lambda: setattr(agent.bus, "store_answers", True))
    agent.later(3.0, lambda: say(scene, agent, 0))
    agent.run_for(work, 4.0)
    assert phases == ["waiting for store (it does not answer)"]
    assert agent.phase == "running"
    assert agent.published(Action) == scene.actions[:1]


def test_it_waits_for_the_task(scene: Any) -> None:
    agent = scene.service("agent")
    experiment = agent.bus.answers.pop(EXPERIMENT)
    phases: list[str] = []
    agent.later(1.0, lambda: phases.append(agent.phase))
    agent.later(2.0, lambda: agent.bus.answers.update({EXPERIMENT: experiment}))
    agent.run_for(work, 3.0)
    assert phases == ["waiting for task (no experiment)"]
    assert agent.run == scene.run


def test_stopped_while_it_waits_it_ends_without_having_said_that_it_is_alive(scene: Any) -> None:
    agent = scene.service("agent")
    agent.bus.answers.clear()
    agent.run_for(work, 1.0)
    assert not any("alive" in token for token in agent.bus.tokens)


def test_queries_are_answered_and_bad_ones_refused_in_words(scene: Any) -> None:
    agent = scene.service("agent")
    play(scene, agent, 0, 5)
    answers: list[Any] = []

    def ask() -> None:
        answers.append(agent.answer_to(QTable, Q_TABLE))
        answers.append(agent.answer_to(PolicyAnswer, f"{POLICY}?state=0"))
        answers.append(agent.answer_to(PolicyAnswer, POLICY))
        answers.append(agent.answer_to(PolicyAnswer, f"{POLICY}?state=seven"))
        answers.append(agent.answer_to(QTable, f"{Q_TABLE}?colour=red"))

    agent.later(1.0, ask)
    agent.run_for(work, 2.0)
    table, policy, *refusals = answers
    assert isinstance(table, QTable) and table.decisions == 5 and table.run == scene.run
    assert isinstance(policy, PolicyAnswer) and policy.known
    assert all(isinstance(refusal, Refusal) and refusal.reason == "bad_request" for refusal in refusals)
    assert "?state=7" in refusals[0].message and "'seven'" in refusals[1].message and "'colour'" in refusals[2].message
    assert agent.refused["BadPayloadError"] == 3
