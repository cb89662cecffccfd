"""Sound inputs of every kind, of which hostile ones are made: what a small run says, learns and stores."""

from __future__ import annotations

from collections.abc import Iterator, Set
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import msgspec

from experiments.fuzz.golden import golden
from experiments.fuzz.mutate import Node
from experiments.lab.skills import skill_from
from services.agent.fold import AgentFold
from services.classifier.fold import ClassifierFold
from services.wire.codec import contract_sha256
from services.wire.definition import Definition
from services.wire.definition_file import definition_sha256, run_id, shipped
from services.wire.messages import (
    Action,
    Checkpoint,
    EpisodeSummary,
    Force,
    JournalEpisode,
    JournalStep,
    Message,
    Observation,
    Reward,
    RunRecord,
    Skill,
    State,
)

DEFINITION = Definition(name="fuzz")
SEED = 5
RUN = run_id(DEFINITION, SEED)
DIRECTIONS: tuple[Force, ...] = ((0.0, 0.0, -2.0), (1.5, 0.0, -0.5), (-1.0, 1.0, -0.25), (0.0, -3.0, -1.0))
Place = dict[str, Any]
TORQUE: Force = (0.01, -0.02, 0.0)


@dataclass
class SmallRun:
    """One finished episode of a run without a bus, and the workers' memories after it."""

    agent: AgentFold
    classifier: ClassifierFold
    messages: list[Message]
    """Every loop message of it, and all that is asked for, answered and stored; at least one of each type."""

    @cached_property
    def trees(self) -> dict[type[Message], list[Node]]:
        """The messages as plain maps and lists, by type."""
        found: dict[type[Message], list[Node]] = {}
        for message in self.messages:
            tree = msgspec.to_builtins(message, builtin_types=(bytes,))
            found.setdefault(type(message), []).append(tree)
        return found

    @property
    def skill(self) -> Skill:
        """What was learnt in it."""
        return next(message for message in self.messages if isinstance(message, Skill))


def small_run() -> SmallRun:
    """Return the small run, always the same."""
    agent, classifier = AgentFold(DEFINITION, RUN, SEED), ClassifierFold(DEFINITION, RUN)
    said: list[Message] = []
    steps: list[JournalStep] = []
    directions = DIRECTIONS * 2
    for number, force_n in enumerate(directions):
        last = number == len(directions) - 1
        place: Place = {"run": RUN, "episode": 0, "step": number + 3, "decision": number}
        observation = Observation(**place, force_n=force_n, torque_nm=TORQUE)
        state = classifier.observe(observation)
        action = agent.decide(state)
        reward = Reward(**place, reward=-1.0, terminal="collision" if last else None)
        agent.reward(reward)
        said += [observation, state, action, reward]
        steps.append(_step(observation, state, action, reward))
    said += _stored(agent, classifier, steps)
    return SmallRun(agent, classifier, [*said, *_others({type(message) for message in said})])


def definitions() -> list[bytes]:
    """Return the files of the definitions that come with Treenail, and a short one."""
    short = b'name = "mine"\n[start]\nx_mm = 2\n[policy]\nkind = "greedy"\n'
    return [short, *(path.read_bytes() for path in shipped().values())]


def _step(observation: Observation, state: State, action: Action, reward: Reward) -> JournalStep:
    return JournalStep(
        step=observation.step,
        force_n=observation.force_n,
        torque_nm=observation.torque_nm,
        state=state.state,
        action=action.action,
        policy_version=action.policy_version,
        reward=reward.reward,
    )


def _stored(agent: AgentFold, classifier: ClassifierFold, steps: list[JournalStep]) -> list[Message]:
    """Return what the store would have of the run."""
    summary = EpisodeSummary(
        run=RUN,
        episode=0,
        episode_return=-8.0,
        moves=11,
        decisions=len(steps),
        mean_force_n=1.5,
        peak_force_n=3.5,
        mean_torque_nm=0.02,
        peak_torque_nm=0.03,
        states=len(DIRECTIONS),
        outcome="collision",
    )
    record = RunRecord(
        run=RUN,
        seed=SEED,
        definition=DEFINITION,
        definition_sha256=definition_sha256(DEFINITION),
        skill_sha256=None,
        contract_sha256=contract_sha256(),
    )
    entry = JournalEpisode(run=RUN, episode=0, first_decision=0, steps=tuple(steps), summary=summary)
    place: Place = {"run": RUN, "episode": 1, "decisions": len(steps), "contract_sha256": contract_sha256()}
    return [
        summary,
        record,
        entry,
        msgspec.structs.replace(entry, steps=entry.steps[:2], summary=None),
        Checkpoint(**place, service="agent", snapshot=agent.snapshot()),
        Checkpoint(**place, service="classifier", snapshot=classifier.snapshot()),
        skill_from(record, 1, agent, classifier, None).skill,
    ]


def _others(made: Set[type[Message]]) -> Iterator[Message]:
    """Give what is asked, answered and moved besides, of the types not made yet: the golden messages, in this run."""
    for message in (row.message for row in golden()):
        if type(message) not in made:
            of_a_run = getattr(message, "run", None) is not None
            yield msgspec.structs.replace(message, run=RUN) if of_a_run else message
