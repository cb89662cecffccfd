"""Sound inputs of every kind, of which hostile ones are made: what a small run says, learns and stores."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import msgspec

from experiments.fuzz.mutate import Node
from experiments.lab.skills import skill_from
from services.agent.fold import AgentFold
from services.classifier.fold import ClassifierFold
from services.wire.actions import action_names
from services.wire.codec import contract_sha256
from services.wire.definition import Definition, Sarsa
from services.wire.definition_file import definition_sha256, run_id, shipped
from services.wire.messages import (
    Action,
    Alive,
    Checkpoint,
    Classified,
    ClassifierStates,
    Complete,
    EpisodeSummary,
    Experiment,
    Force,
    FtPacket,
    Home,
    JournalEpisode,
    JournalStep,
    Message,
    Move,
    Moved,
    Observation,
    PolicyAnswer,
    QTable,
    Refusal,
    Resume,
    Reward,
    RunRecord,
    Skill,
    State,
    Stop,
    Swap,
    Swapped,
    SwapRequest,
    Swaps,
    Truth,
)

DEFINITION = Definition(name="fuzz")
SEED = 5
RUN = run_id(DEFINITION, SEED)
DIRECTIONS: tuple[Force, ...] = ((0.0, 0.0, -2.0), (1.5, 0.0, -0.5), (-1.0, 1.0, -0.25), (0.0, -3.0, -1.0))
Place = dict[str, Any]
TORQUE: Force = (0.01, -0.02, 0.0)
SWAP = Swap(request="0f" * 16, episode=4, learner=Sarsa())


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
    return SmallRun(agent, classifier, [*said, *_stored(agent, classifier, steps), *_answers(agent), *_motions()])


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


def _answers(agent: AgentFold) -> list[Message]:
    """Return what services would answer, with numbers of nobody's in particular."""
    names = action_names(DEFINITION.moves)
    zeros, none = (0.0,) * len(names), (0,) * len(names)
    place: Place = {"run": RUN, "decisions": 8}
    digest = "0f" * 32
    return [
        QTable(
            **place,
            policy_version=8,
            actions=names,
            q=(zeros, zeros),
            visits=(none, none),
            best_action=(0, 4),
            digest=digest,
        ),
        PolicyAnswer(
            run=RUN,
            policy_version=8,
            state=1,
            match=0.98,
            known=True,
            actions=names,
            values=zeros,
            probabilities=zeros,
            visits=none,
            best_action=4,
        ),
        ClassifierStates(
            **place, states=2, encoding="odd", prototypes=((1.0,) * 6, (-0.5,) * 6), counts=(3, 5), digest=digest
        ),
        Classified(**place, states=2, state=None, match=-1.0),
        SwapRequest(run=RUN, request="0f" * 16, after=1, episode=4, classifier=DEFINITION.classifier),
        Swapped(run=RUN, number=1, swap=SWAP),
        Swaps(run=RUN, swaps=(SWAP,)),
        Experiment(
            run=RUN,
            seed=SEED,
            definition=DEFINITION,
            definition_sha256=definition_sha256(DEFINITION),
            skill_sha256=None,
            first_policy_version=0,
            episodes=60,
            episodes_done=1,
            decisions=8,
            phase="running",
            swaps=(SWAP,),
        ),
        Complete(values=3),
        Refusal(reason="guard", message="guard: dz_mm: expected 0.0 to 0.2, got -0.2"),
        Resume(stop_t_ns=1),
        Stop(stop_t_ns=1, why="robot: arm power off"),
        Alive(
            service="agent",
            instance="00000000000000000001-abcdef01",
            host="cell",
            pid=4711,
            version="0.1.0",
            contract_sha256=contract_sha256(),
            started_t_ns=1_700_000_000_000_000_000,
            beat=3,
            handled=200,
            refused={"BadPayloadError": 2},
            run=RUN,
            phase="waiting for store",
        ),
    ]


def _motions() -> list[Message]:
    """Return what goes between task, robot and sensor."""
    place: Place = {"run": RUN, "episode": 0}
    pose = (0.5, -0.25, 1.0, 1.0, 0.0, 0.0, 0.0)
    return [
        Home(**place, x_mm=1.6, y_mm=-2.2, z_mm=-1.0, rx_deg=1.8, ry_deg=0.4, rz_deg=0.0),
        Move(**place, step=1, dz_mm=0.2),
        Moved(**place, step=1, arrived_t_ns=20_000_000, dz_mm=0.2),
        FtPacket(sequence=1, t_ns=20_000_000, force_n=(DIRECTIONS[1],), torque_nm=(TORQUE,)),
        FtPacket(sequence=8, t_ns=10**9, period_ns=125_000, force_n=DIRECTIONS, torque_nm=(TORQUE,) * len(DIRECTIONS)),
        Truth(**place, step=1, flange=pose, peg=pose, contact="one point"),
    ]
