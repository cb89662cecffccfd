"""The journal entry of an episode: what it holds at every stage, and that workers end in the same place by it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from services.agent.fold import AgentFold
from services.classifier.fold import ClassifierFold
from services.task.insertion import Insertion
from services.wire.codec import decode_payload, encode
from services.wire.definition import TD_LEARNERS, Definition
from services.wire.messages import EpisodeSummary, JournalEpisode, JournalStep, Moved, Observation

Make = Callable[..., Any]
RUN = "test-s0"


def test_the_record_grows_with_the_episode(bench: Make) -> None:
    at = bench()
    at.home(episode=6, first_decision=30)
    empty = JournalEpisode(run=RUN, episode=6, first_decision=30, steps=(), summary=None)
    assert at.task.record() == empty
    at.feel(0.0)
    assert at.task.record() == empty

    at.feel(1.0, torque=0.25)
    felt = JournalStep(step=1, force_n=(0.0, 0.0, -1.0), torque_nm=(0.25, 0.0, 0.0))
    assert at.task.record().steps == (felt,)

    at.versions = 9
    at.act(7, state=4)
    acted = JournalStep(
        step=1, force_n=felt.force_n, torque_nm=felt.torque_nm, state=4, action=7, policy_version=9, reward=None
    )
    assert at.task.record().steps == (acted,)

    at.feel(0.0)
    assert at.task.record().steps == (acted,), "the reward is not due while the peg is guided"

    at.feel(2.0)
    first = JournalStep(
        step=1, force_n=felt.force_n, torque_nm=felt.torque_nm, state=4, action=7, policy_version=9, reward=-1.0
    )
    second = JournalStep(step=3, force_n=(0.0, 0.0, -2.0), torque_nm=(0.0, 0.0, 0.0))
    assert at.task.record().steps == (first, second)
    assert at.task.record().summary is None

    at.touch(0, 9.0)
    done = at.task.record()
    assert done.steps[1].reward == -100.0
    assert done.summary == at.summary()
    assert decode_payload(JournalEpisode, encode(done)) == done

    at.home(episode=7, first_decision=32)
    assert at.task.record() == JournalEpisode(run=RUN, episode=7, first_decision=32, steps=(), summary=None)


def test_an_episode_that_nobody_decided_in_has_a_record(bench: Make) -> None:
    at = bench()
    at.home(episode=1, first_decision=5)
    at.feel(9.0)
    record = at.task.record()
    assert record.steps == ()
    assert record.summary == at.summary()


class Run:
    """A whole run against made-up forces: task, classifier and agent by plain calls."""

    def __init__(self, definition: Definition) -> None:
        self.task = Insertion(definition, RUN, 3)
        self.classifier = ClassifierFold(definition, RUN)
        self.agent = AgentFold(definition, RUN, 3)
        self.decisions = 0

    def episode(self, number: int, stop_after: int | None = None) -> JournalEpisode:
        """Run one episode, or a part of it; return its record."""
        forces = np.random.default_rng(number)
        home = self.task.home(number, self.decisions)
        moved = Moved(run=RUN, episode=home.episode, step=0, arrived_t_ns=0)
        while stop_after is None or moved.step < stop_after:
            force = forces.normal(scale=2.0, size=3).tolist()
            torque = forces.normal(scale=0.1, size=3).tolist()
            felt = self.task.feel(moved, tuple(force), tuple(torque))
            if felt.reward is not None:
                self.agent.reward(felt.reward)
            if isinstance(felt.then, EpisodeSummary):
                self.decisions += felt.then.decisions
                break
            motion = felt.then
            if isinstance(motion, Observation):
                motion = self.task.act(self.agent.decide(self.classifier.observe(motion)))
            moved = Moved(run=RUN, episode=number, step=motion.step, arrived_t_ns=0, dz_mm=motion.dz_mm)
        return self.task.record()


def test_the_records_of_a_run_bring_new_workers_to_the_same_place(exact: Make) -> None:
    for kind in ("q_learning", "sarsa"):
        definition = exact(move_limit=40)
        settings = {name: getattr(definition, name) for name in definition.__struct_fields__}
        definition = Definition(**settings | {"learner": TD_LEARNERS[kind]()})
        run = Run(definition)
        classifier, agent = ClassifierFold(definition, RUN), AgentFold(definition, RUN, 3)
        for number in range(8):
            record = decode_payload(JournalEpisode, encode(run.episode(number)))
            classifier.replay(record)
            agent.replay(record)
            assert classifier.network.digest() == run.classifier.network.digest()
            assert agent.learner.digest() == run.agent.learner.digest()
            assert classifier.snapshot() == run.classifier.snapshot()
            assert agent.snapshot() == run.agent.snapshot()
        assert run.decisions > 50
        assert classifier.decisions == agent.decisions == run.decisions


def test_the_record_of_an_episode_under_way_does_too(exact: Make) -> None:
    for stop_after in range(1, 25):
        definition = exact(move_limit=40, collision_force_n=19.0)
        run = Run(definition)
        whole = run.episode(0)
        part = run.episode(1, stop_after)
        classifier, agent = ClassifierFold(definition, RUN), AgentFold(definition, RUN, 3)
        for record in (whole, part):
            classifier.replay(record)
            agent.replay(record)
        assert classifier.network.digest() == run.classifier.network.digest()
        assert agent.learner.digest() == run.agent.learner.digest()
        assert (agent.decisions, agent.rewards) == (run.agent.decisions, run.agent.rewards)
