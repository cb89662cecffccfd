"""A made-up run that is true to itself: what task, classifier and agent would say in it, and what the store has."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from services.agent.fold import AgentFold
from services.bus.fake_bus import FakeBus
from services.bus.testing import FakeService
from services.classifier.fold import ClassifierFold
from services.wire.codec import contract_sha256
from services.wire.definition import Definition
from services.wire.definition_file import definition_sha256, run_id
from services.wire.keys import EXPERIMENT, TASK_STEPS, Keys
from services.wire.messages import (
    Action,
    EpisodeSummary,
    Experiment,
    JournalEpisode,
    JournalStep,
    Observation,
    Reward,
    RunRecord,
    State,
)

LENGTHS = (3, 1, 4, 2) * 12
"""Decisions in each episode: enough episodes for two checkpoints."""
FORCES = ((1.0, 0.2, -2.0), (0.1, 1.0, -2.0), (-1.0, 0.3, -2.0), (0.2, -1.0, -2.0), (0.0, 0.1, -3.0))
SEED = 3


@dataclass
class Scene:
    """The run, decision by decision, and a bus with its task."""

    definition: Definition = field(default_factory=lambda: Definition(name="test"))
    observations: list[Observation] = field(default_factory=list)
    states: list[State] = field(default_factory=list)
    actions: list[Action] = field(default_factory=list)
    rewards: list[Reward] = field(default_factory=list)
    journal: list[JournalEpisode] = field(default_factory=list)
    sessions: dict[str, str] = field(
        default_factory=lambda: {"task": "7a5c", "classifier": "c1a5", "agent": "a6e7", "sim": "51", "store": "5e"}
    )
    """Who holds which role."""

    def __post_init__(self) -> None:
        self.run = run_id(self.definition, SEED, None)
        self.keys = Keys("a")
        classifier = ClassifierFold(self.definition, self.run, ())
        agent = AgentFold(self.definition, self.run, SEED, ())
        for episode, length in enumerate(LENGTHS):
            first = len(self.states)
            steps = tuple(self._decide(classifier, agent, episode, number, length) for number in range(length))
            summary = _summary(self.run, episode, length, self.states[-1].states)
            self.journal.append(
                JournalEpisode(run=self.run, episode=episode, first_decision=first, steps=steps, summary=summary)
            )

    def _decide(
        self, classifier: ClassifierFold, agent: AgentFold, episode: int, number: int, length: int
    ) -> JournalStep:
        decision = len(self.states)
        observed = Observation(
            run=self.run,
            episode=episode,
            step=2 + 3 * number,
            decision=decision,
            force_n=FORCES[(decision * 7 + episode) % len(FORCES)],
            torque_nm=(0.01 * (decision % 3), 0.02, 0.0),
        )
        state = classifier.observe(observed)
        action = agent.decide(state)
        reward = Reward(
            run=self.run,
            episode=episode,
            step=observed.step,
            decision=decision,
            reward=-0.1 * (1 + decision % 5),
            terminal="inserted" if number == length - 1 else None,
        )
        agent.reward(reward)
        self.observations.append(observed)
        self.states.append(state)
        self.actions.append(action)
        self.rewards.append(reward)
        return JournalStep(
            step=observed.step,
            force_n=observed.force_n,
            torque_nm=observed.torque_nm,
            state=state.state,
            action=action.action,
            policy_version=action.policy_version,
            reward=reward.reward,
            increment=action.increment,
        )

    def record(self) -> RunRecord:
        """Return what the store knows of the run."""
        return RunRecord(
            run=self.run,
            seed=SEED,
            definition=self.definition,
            definition_sha256=definition_sha256(self.definition),
            skill_sha256=None,
            contract_sha256=contract_sha256(),
        )

    def experiment(self, episodes_done: int = 0, **changes: object) -> Experiment:
        """Return what the task says that it runs."""
        record = self.record()
        values: dict[str, object] = {
            "run": self.run,
            "seed": SEED,
            "definition": self.definition,
            "definition_sha256": record.definition_sha256,
            "skill_sha256": None,
            "first_policy_version": 0,
            "episodes": len(LENGTHS),
            "episodes_done": episodes_done,
            "decisions": sum(LENGTHS[:episodes_done]),
            "phase": "running",
        }
        return Experiment(**(values | changes))  # type: ignore[arg-type]

    def under_way(self, decisions: int) -> JournalEpisode:
        """Return what the task tells of the episode under way when so much has been decided in the run."""
        episode = next(number for number in range(len(LENGTHS)) if sum(LENGTHS[: number + 1]) >= decisions)
        first = sum(LENGTHS[:episode])
        steps = self.journal[episode].steps[: decisions - first]
        return JournalEpisode(run=self.run, episode=episode, first_decision=first, steps=steps, summary=None)

    def bus(self, episodes_done: int = 0, decisions: int | None = None) -> FakeBus:
        """Return a bus with a task that stands so far, and a store that has all before it."""
        bus = FakeBus()
        self.stand(bus, episodes_done, decisions)
        return bus

    def stand(self, bus: FakeBus, episodes_done: int, decisions: int | None = None) -> None:
        """Let task and store of a bus stand after so many episodes, and so many decisions in all."""
        decided = sum(LENGTHS[:episodes_done]) if decisions is None else decisions
        bus.answers[EXPERIMENT] = self.experiment(episodes_done)
        bus.answers[TASK_STEPS] = self.under_way(decided)
        store = FakeService("store", bus, zid=self.sessions["store"])
        store.store(self.keys.run_record(self.run), self.record())
        for entry in self.journal[:episodes_done]:
            store.store(self.keys.journal(self.run, entry.episode), entry)
            store.store(self.keys.journal_latest(self.run), entry)

    def service(self, name: str, bus: FakeBus | None = None) -> FakeService:
        """Return a service in a cell in which all others hold their roles."""
        service = FakeService(name, self.bus() if bus is None else bus, zid=self.sessions.get(name, "ee"))
        for role, session in self.sessions.items():
            if role != name:
                service.hold(role, session)
        return service


def _summary(run: str, episode: int, decisions: int, states: int) -> EpisodeSummary:
    return EpisodeSummary(
        run=run,
        episode=episode,
        episode_return=-1.0,
        moves=3 * decisions,
        decisions=decisions,
        mean_force_n=1.0,
        peak_force_n=2.0,
        mean_torque_nm=0.0,
        peak_torque_nm=0.0,
        states=states,
        outcome="inserted",
    )


@pytest.fixture(scope="session")
def scene() -> Scene:
    """The run; a test gets a bus of its own from it."""
    return Scene()
