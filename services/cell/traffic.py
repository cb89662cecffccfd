"""What passes in a cell, in figures: rates by key, latencies by Zenoh's timestamps, pace of the run; bounded memory."""

from __future__ import annotations

import math
import statistics
from collections import OrderedDict, deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

from services.rules.progress import WINDOW
from services.wire.codec import decode
from services.wire.errors import ContractError
from services.wire.keys import ACTION, EPISODE, OBSERVATION, REWARD, STATE
from services.wire.messages import Action, Alive, EpisodeSummary, LoopMessage, Message, Observation, Reward, State

LEGS = {
    "classifier": (OBSERVATION, STATE),
    "agent": (STATE, ACTION),
    "robot": (ACTION, REWARD),
    "decision": (OBSERVATION, REWARD),
}
"""What is timed, each from one message of a decision to another."""
GROUPED = ("journal", "checkpoint", "heartbeat", "claim")
"""Keys with names of their own below them, which are counted together."""
HEARTBEAT = "heartbeat/"
OTHERS = "(others)"
MAX_NAMES = 40
"""Keys and services that are told apart; a stranger may publish on any number of them."""
MAX_OPEN = 1000
MAX_TIMED = 4096
_LOOP: dict[str, type[LoopMessage]] = {OBSERVATION: Observation, STATE: State, ACTION: Action, REWARD: Reward}


M = TypeVar("M", bound=Message)


class Published(NamedTuple):
    """One message as it arrived."""

    name: str
    """Key within the cell."""
    payload: bytes
    encoding: str
    sent_ns: int | None
    """Zenoh's timestamp, of the sender's clock."""


@dataclass
class Count:
    """What has passed on one key."""

    messages: int = 0
    payload_bytes: int = 0
    bad: int = 0
    """Messages that do not follow the contract."""


@dataclass
class Heart:
    """The last two heartbeats of a service; times of the clock that ``Traffic.take`` is given [s]."""

    last: Alive
    at_s: float
    handled_per_s: float | None = None


@dataclass
class Latencies:
    """Times between the messages of one decision [ns]; a message that is repeated counts as first sent."""

    timed: dict[str, deque[int]] = field(default_factory=lambda: {leg: deque(maxlen=MAX_TIMED) for leg in LEGS})
    _open: OrderedDict[tuple[str, int], dict[str, int]] = field(default_factory=OrderedDict)

    def note(self, name: str, run: str, decision: int, sent_ns: int) -> None:
        """Note when one of the four messages of a decision was sent; they may come in any order."""
        sent = self._open.setdefault((run, decision), {})
        sent.setdefault(name, sent_ns)
        if len(sent) == len(_LOOP):
            del self._open[run, decision]
            for leg, (first, last) in LEGS.items():
                self.timed[leg].append(sent[last] - sent[first])
        elif len(self._open) > MAX_OPEN:
            self._open.popitem(last=False)


@dataclass
class Pace:
    """Motions and episodes of the run, counted from the first message on."""

    moves: int = 0
    episodes: int = 0
    returns: deque[float] = field(default_factory=lambda: deque(maxlen=WINDOW))
    run: str | None = None
    swaps: int = 0
    """Swaps in force, as the newest observation says."""
    _at: tuple[int, int] | None = None
    """Episode under way and the motions made in it; None before anything was seen of the run."""

    def observe(self, run: str, episode: int, step: int, swaps: int = 0) -> None:
        """Count the motions up to an observation."""
        self._follow(run)
        self.swaps = swaps
        if self._at is not None and (episode, step) >= self._at:
            self.moves += step - (self._at[1] if episode == self._at[0] else 0)
        if self._at is None or (episode, step) >= self._at:
            self._at = (episode, step)

    def finish(self, summary: EpisodeSummary) -> None:
        """Count a finished episode, and its motions since the last observation."""
        self._follow(summary.run)
        if self._at is not None and summary.episode < self._at[0]:
            return
        if self._at is not None:
            self.moves += max(0, summary.moves - (self._at[1] if summary.episode == self._at[0] else 0))
        self._at = (summary.episode + 1, 0)
        self.episodes += 1
        self.returns.append(summary.episode_return)

    def _follow(self, run: str) -> None:
        if run != self.run:
            self.run, self._at = run, None
            self.returns.clear()


class _Mark(NamedTuple):
    """Where the counters stood at a time, to measure rates from."""

    at_s: float
    counts: dict[str, tuple[int, int]]
    moves: int
    episodes: int


class Traffic:
    """Counts what passes; whatever arrives, it goes on."""

    def __init__(self, now_s: float, marks: int) -> None:
        """Rates are measured from the oldest of the last ``marks`` calls of ``mark``, or from the start ``now_s``."""
        self.counts: dict[str, Count] = {}
        self.hearts: dict[str, Heart] = {}
        self.latencies = Latencies()
        self.pace = Pace()
        self.complete = True
        """Whether all that passed was seen."""
        self._marks: deque[_Mark] = deque([_Mark(now_s, {}, 0, 0)], maxlen=marks)

    def take(self, message: Published, now_s: float) -> None:
        """Count one message that arrived at ``now_s``."""
        count = self._count(message.name)
        count.messages += 1
        count.payload_bytes += len(message.payload)
        try:
            self._read(message, now_s)
        except ContractError:
            count.bad += 1

    def mark(self, now_s: float) -> None:
        """Let rates be measured from here, as time goes on."""
        counts = {name: (one.messages, one.payload_bytes) for name, one in self.counts.items()}
        self._marks.append(_Mark(now_s, counts, self.pace.moves, self.pace.episodes))

    def rates(self, now_s: float) -> dict[str, tuple[float, float]]:
        """Return messages [1/s] and payload [kB/s] by key."""
        mark = self._marks[0]
        span_s = max(now_s - mark.at_s, 1e-9)
        found = {}
        for name in sorted(self.counts):
            one, (messages, size) = self.counts[name], mark.counts.get(name, (0, 0))
            found[name] = ((one.messages - messages) / span_s, (one.payload_bytes - size) / span_s / 1000)
        return found

    def moves_per_s(self, now_s: float) -> float:
        """Return the motions of the robot per second."""
        return (self.pace.moves - self._marks[0].moves) / max(now_s - self._marks[0].at_s, 1e-9)

    def episodes_per_min(self, now_s: float) -> float:
        """Return the finished episodes per minute."""
        return 60 * (self.pace.episodes - self._marks[0].episodes) / max(now_s - self._marks[0].at_s, 1e-9)

    def latency_us(self) -> dict[str, tuple[int, float, float] | None]:
        """Return number, median and 99th percentile [us] by leg; None where nothing was timed."""
        found: dict[str, tuple[int, float, float] | None] = {}
        for leg, timed in self.latencies.timed.items():
            middle = (len(timed), statistics.median(timed) / 1000, percentile(timed, 99) / 1000) if timed else None
            found[leg] = middle
        return found

    def _count(self, name: str) -> Count:
        first = name.partition("/")[0]
        group = first if first in GROUPED else name
        if group not in self.counts and len(self.counts) >= MAX_NAMES:
            group = OTHERS
        return self.counts.setdefault(group, Count())

    def _read(self, message: Published, now_s: float) -> None:
        name = message.name
        if name.startswith(HEARTBEAT):
            self._beat(name.removeprefix(HEARTBEAT), _decoded(Alive, message), now_s)
        elif name == EPISODE:
            self.pace.finish(_decoded(EpisodeSummary, message))
        elif name in _LOOP:
            found = _decoded(_LOOP[name], message)
            if name == OBSERVATION:
                self.pace.observe(found.run, found.episode, found.step, found.swaps)
            if message.sent_ns is not None:
                self.latencies.note(name, found.run, found.decision, message.sent_ns)

    def _beat(self, service: str, alive: Alive, now_s: float) -> None:
        before = self.hearts.get(service)
        if before is None and len(self.hearts) >= MAX_NAMES:
            return
        handled_per_s = None
        if before is not None and before.last.instance == alive.instance and now_s > before.at_s:
            handled_per_s = (alive.handled - before.last.handled) / (now_s - before.at_s)
        self.hearts[service] = Heart(alive, now_s, handled_per_s)


def _decoded(kind: type[M], message: Published) -> M:
    return decode(kind, message.payload, message.encoding)


def percentile(values: Sequence[float], percent: float) -> float:
    """Return the least of ``values`` that so many percent of them do not exceed."""
    ordered = sorted(values)
    return ordered[max(0, math.ceil(len(ordered) * percent / 100) - 1)]
