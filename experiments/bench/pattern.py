"""The loop in one process, watched: how long its physics takes, and which messages it would send in which order."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

from experiments.bench.bare_chain import Decision, Exchange, Motion, Rewarded
from experiments.lab.in_process import InProcessRun
from services.agent.fold import AgentFold
from services.classifier.fold import ClassifierFold
from services.sim.cell import SimulatedCell
from services.wire.codec import encode
from services.wire.definition import Definition
from services.wire.messages import (
    Action,
    EpisodeSummary,
    FtPacket,
    Home,
    Message,
    Move,
    Moved,
    Observation,
    Reward,
    State,
)


class Timed(NamedTuple):
    """What some episodes took in one process."""

    motions: int
    decisions: int
    total_s: float
    physics_s: float
    """Of that, inside the simulated cell."""


class Pattern(NamedTuple):
    """Messages of some episodes."""

    exchanges: tuple[Exchange, ...]
    summaries: tuple[EpisodeSummary, ...]

    @property
    def motions(self) -> int:
        """Number of motions, homing included."""
        return sum(isinstance(exchange, Motion) for exchange in self.exchanges)

    @property
    def decisions(self) -> int:
        """Number of decisions."""
        return sum(isinstance(exchange, Decision) for exchange in self.exchanges)


class _TimedCell(SimulatedCell):
    """A simulated cell that knows how long it has worked."""

    seconds = 0.0
    motions = 0

    def home(self, home: Home) -> tuple[Moved, FtPacket]:
        """Home, and count the time."""
        began = time.perf_counter()
        answer = super().home(home)
        self.seconds += time.perf_counter() - began
        self.motions += 1
        return answer

    def move(self, move: Move) -> tuple[Moved, FtPacket]:
        """Move, and count the time."""
        began = time.perf_counter()
        answer = super().move(move)
        self.seconds += time.perf_counter() - began
        self.motions += 1
        return answer


def timed(definition: Definition, seed: int, episodes: int, skipped: int = 1) -> Timed:
    """Run ``skipped`` episodes and then ``episodes`` that count, without noting more than the time."""
    run = InProcessRun(definition, seed)
    run.cell = cell = _TimedCell(definition, run.run, seed)
    list(run.episodes(skipped))
    physics_s, motions, decisions, began = cell.seconds, cell.motions, run.decisions, time.perf_counter()
    list(run.episodes(episodes))
    total_s = time.perf_counter() - began
    return Timed(cell.motions - motions, run.decisions - decisions, total_s, cell.seconds - physics_s)


def pattern(definition: Definition, seed: int, episodes: int, skipped: int = 1) -> Pattern:
    """Run ``skipped`` episodes and then ``episodes`` whose messages are noted, in the order of the distributed loop."""
    run = InProcessRun(definition, seed)
    noted: list[tuple[Message, ...]] = []
    run.cell = _NotingCell(definition, run.run, seed, noted)
    run.classifier = _NotingClassifier(definition, run.run, noted)
    run.agent = _NotingAgent(definition, run.run, seed, noted)
    list(run.episodes(skipped))
    noted.clear()
    summaries = tuple(run.episodes(episodes))
    return Pattern(tuple(_exchanges(noted)), summaries)


def _exchanges(noted: Sequence[tuple[Message, ...]]) -> list[Exchange]:
    """Return the lengths of the messages; a classifier's part of a decision is followed by the agent's."""
    exchanges: list[Exchange] = []
    observation = state = 0
    for messages in noted:
        sizes = [len(encode(message)) for message in messages]
        if isinstance(messages[0], Home | Move):
            exchanges.append(Motion(*sizes))
        elif isinstance(messages[0], Reward):
            exchanges.append(Rewarded(*sizes))
        elif isinstance(messages[0], Observation):
            observation, state = sizes
        else:
            exchanges.append(Decision(observation, state, *sizes))
    return exchanges


class _NotingCell(SimulatedCell):
    """A simulated cell that notes what passes."""

    def __init__(self, definition: Definition, run: str, seed: int, noted: list[tuple[Message, ...]]) -> None:
        super().__init__(definition, run, seed)
        self._noted = noted

    def home(self, home: Home) -> tuple[Moved, FtPacket]:
        """Home, and note it."""
        return self._note(home, super().home(home))

    def move(self, move: Move) -> tuple[Moved, FtPacket]:
        """Move, and note it."""
        return self._note(move, super().move(move))

    def _note(self, request: Home | Move, answer: tuple[Moved, FtPacket]) -> tuple[Moved, FtPacket]:
        moved, packet = answer
        self._noted.append((request, packet, moved))
        return answer


class _NotingClassifier(ClassifierFold):
    """A classifier that notes what passes."""

    def __init__(self, definition: Definition, run: str, noted: list[tuple[Message, ...]]) -> None:
        super().__init__(definition, run)
        self._noted = noted

    def observe(self, observation: Observation) -> State:
        """Classify, and note it."""
        state = super().observe(observation)
        self._noted.append((observation, state))
        return state


class _NotingAgent(AgentFold):
    """An agent that notes what passes."""

    def __init__(self, definition: Definition, run: str, seed: int, noted: list[tuple[Message, ...]]) -> None:
        super().__init__(definition, run, seed)
        self._noted = noted

    def decide(self, state: State) -> Action:
        """Decide, and note it."""
        action = super().decide(state)
        self._noted.append((action,))
        return action

    def reward(self, reward: Reward) -> bool:
        """Learn, and note it."""
        self._noted.append((reward,))
        return super().reward(reward)
