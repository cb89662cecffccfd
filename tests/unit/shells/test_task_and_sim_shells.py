"""Task and simulator without processes: the run through their shells is the one in a process, whatever is lost."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from experiments.lab.in_process import InProcessRun
from services.bus.fake_bus import FakeBus, FakeQuery
from services.bus.testing import FakeService
from services.sim import service as sim_service
from services.sim.cell import SimulatedCell
from services.task.service import REPEAT_S, work
from services.wire.definition import Definition
from services.wire.definition_file import load
from services.wire.errors import TreenailError
from services.wire.keys import ACTION, EXPERIMENT, FT, HOME, MOVE, OBSERVATION, REWARD, SWAP
from services.wire.messages import (
    EpisodeSummary,
    Experiment,
    FtPacket,
    Home,
    JournalEpisode,
    Message,
    Move,
    Moved,
    Observation,
    Refusal,
    Reward,
    Swapped,
    Truth,
)

SEED, EPISODES = 1, 3


@pytest.fixture(scope="module")
def definition(small: Path) -> Definition:
    return load(str(small))


@pytest.fixture(scope="module")
def expected(definition: Definition) -> list[EpisodeSummary]:
    return list(InProcessRun(definition, SEED).episodes(EPISODES))


class Others:
    """Robot, classifier and agent of a task's cell, as another process would be: they answer what they hear."""

    def __init__(self, definition: Definition, task: FakeService) -> None:
        self._task = task
        run = InProcessRun(definition, SEED)
        self._classifier, self._agent = run.classifier, run.agent
        self.robot = SimulatedCell(definition, run.run, SEED)
        self.deaf: Callable[[Message], bool] = lambda _: False
        """Says what of all that the task says gets lost."""
        self.observed: list[Observation] = []
        for role, session in (("sim", "51"), ("classifier", "c1"), ("agent", "a6")):
            task.hold(role, session)
        task.bus.answers |= {HOME: self._home, MOVE: self._move}
        task.bus.on(task.keys.of(OBSERVATION), Observation, self._observe)
        task.bus.on(task.keys.of(REWARD), Reward, self._reward)

    def _home(self, query: FakeQuery) -> Message | None:
        return self._moved(query.message(Home), self.robot.home)

    def _move(self, query: FakeQuery) -> Message | None:
        return self._moved(query.message(Move), self.robot.move)

    def _moved(self, motion: Any, make: Callable[[Any], tuple[Moved, FtPacket]]) -> Message | None:
        if self.deaf(motion):
            return None
        try:
            moved, packet = make(motion)
        except TreenailError as error:
            return Refusal(reason=getattr(error, "reason", "bad_request"), message=str(error))
        self._task.hear(FT, packet, "51")
        return moved

    def _observe(self, observation: Observation) -> None:
        self.observed.append(observation)
        if not self.deaf(observation):
            action = self._agent.decide(self._classifier.observe(observation))
            self._task.hear(ACTION, action, "a6")

    def _reward(self, reward: Reward) -> None:
        self._agent.reward(reward)


def kill_simulator(others: Others, definition: Definition, seed: int) -> list[int]:
    """Kill the simulator after nine decisions of every episode; return the list of those in which it was, so far."""
    killed: list[int] = []

    def kill(message: Message) -> bool:
        if isinstance(message, Move) and message.step == 9 and message.episode not in killed:
            killed.append(message.episode)
            others.robot = SimulatedCell(definition, message.run, seed)
        return False

    others.deaf = kill
    return killed


def run_task(definition: Definition, bus: FakeBus | None = None) -> tuple[FakeService, Others]:
    task = FakeService("task", bus, zid="7a")
    others = Others(definition, task)
    return task, others


def test_the_run_is_the_one_in_a_process(definition: Definition, expected: list[EpisodeSummary]) -> None:
    task, _ = run_task(definition)
    task.run_for(lambda service: work(service, definition, SEED, EPISODES), 60.0)
    assert task.published(EpisodeSummary) == expected
    assert task.phase == "finished"
    assert not task.refused


def test_a_run_with_a_window_of_samples_is_the_one_in_a_process(definition: Definition) -> None:
    noise = replace(definition.noise, force_n=0.1, torque_nm=0.01)
    windowed = replace(definition, noise=noise, sensor=replace(definition.sensor, window=16))
    task, _ = run_task(windowed)
    task.run_for(lambda service: work(service, windowed, SEED, EPISODES), 60.0)
    assert task.published(EpisodeSummary) == list(InProcessRun(windowed, SEED).episodes(EPISODES))
    assert not task.refused


@pytest.fixture(scope="module")
def filtered(definition: Definition) -> Definition:
    noise = replace(definition.noise, force_n=0.1, torque_nm=0.01)
    sensor = replace(definition.sensor, window=4, rate_hz=1000, filter_hz=31.25)
    return replace(definition, noise=noise, sensor=sensor, limits=replace(definition.limits, hard_force_n=40.0))


def test_a_run_behind_a_filter_is_the_one_in_a_process_whenever_the_simulator_is_killed(filtered: Definition) -> None:
    task, others = run_task(filtered)
    killed = kill_simulator(others, filtered, SEED)
    task.run_for(lambda service: work(service, filtered, SEED, EPISODES), 60.0)
    assert killed == list(range(EPISODES))
    assert task.published(EpisodeSummary) == list(InProcessRun(filtered, SEED).episodes(EPISODES))
    assert not task.refused


def test_what_is_lost_is_said_again(definition: Definition, expected: list[EpisodeSummary]) -> None:
    task, others = run_task(definition)
    lost: set[object] = set()

    def once(message: Message) -> bool:
        """Lose every third message the first time that it is said."""
        new = message not in lost
        lost.add(message)
        return new and len(lost) % 3 == 0

    others.deaf = once
    task.run_for(lambda service: work(service, definition, SEED, EPISODES), 4000.0)
    assert task.published(EpisodeSummary) == expected
    assert len(others.observed) > len(set(others.observed))


def test_a_task_that_is_started_again_goes_on_where_the_journal_ends(
    definition: Definition, expected: list[EpisodeSummary]
) -> None:
    bus = FakeBus()
    first, _ = run_task(definition, bus)
    first.run_for(lambda service: work(service, definition, SEED, 2), 60.0)
    bus.tokens.clear()
    bus.forget_others()
    second = FakeService("task", bus, zid="7b")
    others = Others(definition, second)
    for entry in first.published(JournalEpisode)[::2]:  # each is put twice: as itself and as the newest
        others._classifier.replay(entry)
        others._agent.replay(entry)
    second.run_for(lambda service: work(service, definition, SEED, EPISODES), 60.0)
    assert second.published(EpisodeSummary) == expected
    assert [summary.episode for summary in second.published(EpisodeSummary)] == list(range(EPISODES))


def test_it_waits_loudly_for_who_is_missing_and_ends_when_told(definition: Definition) -> None:
    task, others = run_task(definition)
    others.deaf = lambda message: isinstance(message, Observation)
    task.run_for(lambda service: work(service, definition, SEED, EPISODES), 10 * REPEAT_S)
    assert task.phase == "waiting for agent and classifier"
    assert task.published(EpisodeSummary) == []
    assert len(others.observed) >= 8


def test_it_waits_for_a_robot_and_for_a_store(definition: Definition) -> None:
    task, others = run_task(definition)
    others.deaf = lambda message: isinstance(message, Home)
    task.run_for(lambda service: work(service, definition, SEED, EPISODES), 10.0)
    assert task.phase == "waiting for robot (no answer to a motion)"
    blank, _ = run_task(definition)
    blank.bus.store_answers = False
    blank.run_for(lambda service: work(service, definition, SEED, EPISODES), 10.0)
    assert blank.phase.startswith("waiting for store")
    assert blank.published(Observation) == []


def test_an_action_of_a_stranger_moves_nothing(definition: Definition, expected: list[EpisodeSummary]) -> None:
    task, others = run_task(definition)
    decide = InProcessRun(definition, SEED)

    def forge(message: Message) -> bool:
        """Say first, as a stranger, what the agent would say, but for the action."""
        if isinstance(message, Observation):
            action = decide.agent.decide(decide.classifier.observe(message))
            task.hear(ACTION, replace(action, action=(action.action + 1) % definition.moves.actions))
        elif isinstance(message, Reward):
            decide.agent.reward(message)
        return False

    others.deaf = forge
    task.bus.on(task.keys.of(REWARD), Reward, forge)
    task.run_for(lambda service: work(service, definition, SEED, EPISODES), 60.0)
    assert task.published(EpisodeSummary) == expected
    assert task.refused == {"StrangerError": len(others.observed)}


def test_queries_about_the_run_are_answered(definition: Definition) -> None:
    task, _ = run_task(definition)
    answers: list[Any] = []
    task.later(30.0, lambda: answers.append(task.answer_to(Experiment, EXPERIMENT)))
    task.later(31.0, lambda: answers.append(task.answer_to(Swapped, SWAP)))
    task.run_for(lambda service: work(service, definition, SEED, EPISODES), 60.0)
    experiment, swap = answers
    assert (experiment.episodes_done, experiment.phase) == (EPISODES, "finished")
    assert isinstance(swap, Refusal)


def test_the_simulator_answers_motions_says_what_is_felt_and_refuses_what_does_not_follow(
    definition: Definition, expected: list[EpisodeSummary]
) -> None:
    run = InProcessRun(definition, SEED)
    sim = FakeService("sim")
    sim.bus.answers[EXPERIMENT] = Experiment(
        run=run.run,
        seed=SEED,
        definition=definition,
        definition_sha256=run.record.definition_sha256,
        skill_sha256=None,
        first_policy_version=0,
        episodes=EPISODES,
        episodes_done=0,
        decisions=0,
        phase="running",
    )
    answers: list[Any] = []
    home = run.task.home(0, 0, ())
    early = Move(run=run.run, episode=0, step=2, dx_mm=0, dy_mm=0, dz_mm=-0.1, rx_deg=0, ry_deg=0, rz_deg=0)

    def ask(name: str, motion: Message) -> None:
        answers.append(sim.answer_to(Moved, name, motion))

    for number, (name, motion) in enumerate(((MOVE, early), (HOME, home), (HOME, home), (MOVE, early))):
        sim.later(1.0 + number, partial(ask, name, motion))
    sim.run_for(sim_service.work, 10.0)
    assert isinstance(answers[0], Refusal) and isinstance(answers[3], Refusal)
    assert isinstance(answers[1], Moved) and answers[1] == answers[2]
    assert sim.published(FtPacket)[0] == SimulatedCell(definition, run.run, SEED).home(home)[1]
    assert sim.published(Truth)
