"""The contract: every key of a cell, what is said under it, and who may. All lie under ``treenail/<cell>/``.

Everything else that has to do with keys follows from ``CONTRACT``: docs/contract.md, the access rules of a secured
cell, what the store takes and what it may forget.
"""

from __future__ import annotations

import re
from functools import cache
from typing import NamedTuple

from services.wire.errors import TreenailError
from services.wire.messages import (
    Action,
    Alive,
    Checkpoint,
    Classified,
    ClassifierStates,
    EpisodeSummary,
    Experiment,
    FtPacket,
    Home,
    JournalEpisode,
    Message,
    Move,
    Moved,
    Observation,
    PolicyAnswer,
    QTable,
    Resume,
    Reward,
    RunRecord,
    Skill,
    State,
    Stop,
    Swapped,
    SwapRequest,
    Swaps,
    Truth,
)

ROOT = "treenail"
JOURNAL_BLOCK = 100
"""Episodes per block of the journal, so that a worker can fetch the part it needs with plain wildcards."""

FT = "ft"
OBSERVATION = "observation"
STATE = "state"
ACTION = "action"
REWARD = "reward"
EPISODE = "episode"
MOVE = "move"
HOME = "home"
RESUME = "resume"
EXPERIMENT = "experiment"
TASK_STEPS = "task/steps"
SWAP = "swap"
TRUTH = "sim/truth"
Q_TABLE = "agent/q_table"
POLICY = "agent/policy"
CLASSIFIER_STATES = "classifier/states"
CLASSIFY = "classifier/classify"
LATEST = "latest"
RUN = "journal/<run>/run"
ENTRY = "journal/<run>/<block>/<episode>"
SWAPS = "journal/<run>/all-swaps"
NEWEST_ENTRY = f"journal/<run>/{LATEST}"
CHECKPOINT = "checkpoint/<run>/<service>/<episode>"
NEWEST_CHECKPOINT = f"checkpoint/<run>/<service>/{LATEST}"
SKILL = "checkpoint/skill/<sha256>"
CHOSEN_SKILL = f"checkpoint/skill/{LATEST}"
ALIVE = "alive/<service>"
CLAIM = "claim/<service>/<instance>"
HEARTBEAT = "heartbeat/<service>"
HEAD = "journal/<run>/*"
"""What a run is, its swaps and its newest episode, asked for at once."""

SERVICES = (
    "sim",
    "sensor_jr3",
    "robot_link",
    "robot_ur",
    "sensor_rdt",
    "task",
    "classifier",
    "agent",
    "store",
    "viewer",
    "ros2_out",
    "ros2_robot",
    "ros2_sensor",
)
OPERATOR, GUEST = "operator", "guest"
CLIENTS = (*SERVICES, OPERATOR, GUEST)
"""Everybody but the router, by the name in a certificate."""
READERS = ("viewer", "ros2_out", OPERATOR, GUEST)
WORKERS = ("classifier", "agent")
ROBOTS = ("sim", "robot_link", "robot_ur", "ros2_robot")
"""Who answers motions."""
SENSORS = ("sim", "sensor_jr3", "sensor_rdt", "robot_ur", "ros2_sensor")
"""Who publishes what is felt; the wrist of robot_ur is one."""


class Access(NamedTuple):
    """Who may do what with a key. Under one with ``<service>``, a service speaks with its own name there only."""

    put: tuple[str, ...] = ()
    delete: tuple[str, ...] = ()
    hear: tuple[str, ...] = ()
    """Subscribe, and get what is put."""
    ask: tuple[str, ...] = ()
    answer: tuple[str, ...] = ()
    be: tuple[str, ...] = ()
    """Hold a liveliness token."""
    watch: tuple[str, ...] = ()
    """See the liveliness tokens of others."""


class Row(NamedTuple):
    """What the contract says of one key."""

    kind: str
    """pub, query, put (kept by the store), liveliness, or two of them."""
    types: tuple[type[Message], ...]
    """What is put or answered; before it what is asked with, if a question has a payload."""
    access: Access
    what: str
    to: tuple[str, ...] = ()
    """For whom it is meant, where more may hear it."""

    @property
    def route(self) -> str:
        """From whom it comes, and to whom it goes, in words."""
        access = self.access
        if self.kind == "pub":
            return f"{people(access.put)} -> {people(self.to or access.hear)}"
        if self.kind == "query":
            return f"{people(access.ask)} -> {' or '.join(access.answer)}"
        return f"{people(access.put)} <-> store" if access.put else people(access.be)


CONTRACT: dict[str, Row] = {
    FT: Row(
        "pub",
        (FtPacket,),
        Access(put=SENSORS, hear=("task", "robot_link", "robot_ur", "ros2_robot", *READERS)),
        "what the wrist feels",
        ("task", "viewer"),
    ),
    OBSERVATION: Row(
        "pub",
        (Observation,),
        Access(put=("task",), hear=("classifier", *READERS)),
        "an F/T sample to classify, in contact only",
        ("classifier",),
    ),
    STATE: Row(
        "pub",
        (State,),
        Access(put=("classifier",), hear=("agent", *READERS)),
        "its contact state",
        ("agent", "viewer"),
    ),
    ACTION: Row(
        "pub",
        (Action,),
        Access(put=("agent",), hear=("task", *READERS)),
        "what to do in that state",
        ("task", "viewer"),
    ),
    REWARD: Row(
        "pub",
        (Reward,),
        Access(put=("task",), hear=("agent", *READERS)),
        "what came of it",
        ("agent", "viewer"),
    ),
    EPISODE: Row("pub", (EpisodeSummary,), Access(put=("task",), hear=CLIENTS), "one finished episode"),
    MOVE: Row("query", (Move, Moved), Access(ask=("task",), answer=ROBOTS), "one increment"),
    HOME: Row("query", (Home, Moved), Access(ask=("task",), answer=ROBOTS), "to the start pose of an episode"),
    RESUME: Row("query", (Resume, Stop), Access(ask=(OPERATOR,), answer=ROBOTS), "let the arm move again after a stop"),
    EXPERIMENT: Row("query", (Experiment,), Access(ask=CLIENTS, answer=("task",)), "what runs, and how far it is"),
    SWAP: Row(
        "query",
        (SwapRequest, Swapped),
        Access(ask=(OPERATOR,), answer=("task",)),
        "another classifier, learner or policy from an episode on",
    ),
    TASK_STEPS: Row(
        "query", (JournalEpisode,), Access(ask=WORKERS, answer=("task",)), "the decisions of the episode under way"
    ),
    Q_TABLE: Row("query", (QTable,), Access(ask=CLIENTS, answer=("agent",)), "all action values"),
    POLICY: Row(
        "query",
        (PolicyAnswer,),
        Access(ask=CLIENTS, answer=("agent",)),
        "`?state=7` or `?ft=fx,fy,fz,tx,ty,tz`: values, best action",
    ),
    CLASSIFIER_STATES: Row(
        "query", (ClassifierStates,), Access(ask=CLIENTS, answer=("classifier",)), "prototypes and counts"
    ),
    CLASSIFY: Row(
        "query",
        (Classified,),
        Access(ask=CLIENTS, answer=("classifier",)),
        "`?ft=fx,fy,fz,tx,ty,tz` [N, N m]: its contact state",
    ),
    TRUTH: Row(
        "pub",
        (Truth,),
        Access(put=("sim",), hear=READERS),
        "the true pose, some 30 times a second; never seen by a learner",
        ("viewer",),
    ),
    RUN: Row("put, query", (RunRecord,), Access(put=("task",)), "what the run is"),
    ENTRY: Row("put, query", (JournalEpisode,), Access(put=("task",)), "one episode"),
    SWAPS: Row("put, query", (Swaps,), Access(put=("task",)), "what was swapped, and from which episode on"),
    NEWEST_ENTRY: Row("put, query", (JournalEpisode,), Access(put=("task",)), "the newest episode once more"),
    CHECKPOINT: Row("put, query", (Checkpoint,), Access(put=WORKERS, ask=WORKERS), "memory before it"),
    NEWEST_CHECKPOINT: Row("put, query", (Checkpoint,), Access(put=WORKERS, ask=WORKERS), "the newest once more"),
    SKILL: Row(
        "put, query",
        (Skill,),
        Access(put=("task", OPERATOR), delete=(OPERATOR,), ask=("task", *WORKERS)),
        "a learnt skill, named by its hash",
    ),
    CHOSEN_SKILL: Row(
        "put, query",
        (Skill,),
        Access(put=("task", OPERATOR), delete=(OPERATOR,), hear=("task",), ask=("task", *WORKERS)),
        "the one that the next run begins with",
    ),
    ALIVE: Row(
        "liveliness, query",
        (Alive,),
        Access(ask=CLIENTS, answer=SERVICES, be=SERVICES, watch=CLIENTS),
        "who is here",
    ),
    CLAIM: Row("liveliness", (), Access(be=SERVICES, watch=CLIENTS), "who holds a role: one per cell"),
    HEARTBEAT: Row("pub", (Alive,), Access(put=SERVICES, hear=CLIENTS), "once a second, from the work loop"),
}
"""By key, with ``<part>`` for what differs."""

STORED: dict[str, Access] = {
    "journal/**": Access(hear=("store", *READERS), ask=("task", *WORKERS, *READERS), answer=("store",)),
    "checkpoint/**": Access(hear=("store", *READERS), ask=READERS, answer=("store",)),
}
"""What the store serves, and what may be asked for with one question."""

_CELL = re.compile(r"^[a-z0-9][a-z0-9_-]{0,31}\Z")
_PART = re.compile(r"<(\w+)>")
_FORMS = {
    "run": r"[0-9a-z][0-9a-z-]{0,79}",
    "service": r"[a-z][a-z0-9_]{0,31}",
    "block": r"[0-9]{6}",
    "episode": r"[0-9]{8}",
    "sha256": r"[0-9a-f]{64}",
    "instance": r"[^/]+",
}
"""What stands for each part."""


class Named(NamedTuple):
    """Which key of the contract a name is, and its parts."""

    pattern: str
    parts: dict[str, str]

    @property
    def episode(self) -> int | None:
        """The episode in it, if it has one."""
        return int(self.parts["episode"]) if "episode" in self.parts else None


def named(name: str) -> Named | None:
    """Return which key of the contract a name within a cell is; None for one that the contract does not have."""
    for pattern, form in _forms():
        if match := form.fullmatch(name):
            block, episode = match.groupdict().get("block"), match.groupdict().get("episode")
            if block is not None and episode is not None and int(block) != int(episode) // JOURNAL_BLOCK:
                return None
            return Named(pattern, match.groupdict())
    return None


def name_of(pattern: str, **parts: str | int) -> str:
    """Return a name within a cell: a key of the contract with these parts, and ``*`` for those that are not given.

    The block of the journal follows from the episode.
    """
    if "block" not in parts and isinstance(parts.get("episode"), int):
        parts["block"] = int(parts["episode"]) // JOURNAL_BLOCK
    digits = {"block": 6, "episode": 8}
    words = {part: f"{value:0{digits[part]}d}" if isinstance(value, int) else value for part, value in parts.items()}
    return _PART.sub(lambda match: words.get(match[1], "*"), pattern)


def wild(pattern: str) -> str:
    """Return the key expression of all names of a key of the contract."""
    return _PART.sub("*", pattern)


def people(names: tuple[str, ...]) -> str:
    """Return some names, with a word for the groups that occur often."""
    for group, word in ((CLIENTS, "everyone"), (SERVICES, "each service"), (READERS, "readers")):
        if set(group) <= set(names):
            return ", ".join([*(name for name in names if name not in group), word])
    return ", ".join(names)


@cache
def _forms() -> tuple[tuple[str, re.Pattern[str]], ...]:
    """Return the keys of the contract as regular expressions."""
    forms = []
    for pattern in CONTRACT:
        # re.split with a group gives text and part names in turn.
        texts = _PART.split(pattern)
        pieces = [
            re.escape(text) if place % 2 == 0 else f"(?P<{text}>{_FORMS[text]})" for place, text in enumerate(texts)
        ]
        forms.append((pattern, re.compile("".join(pieces))))
    return tuple(forms)


class Keys:
    """The keys of one cell."""

    def __init__(self, cell: str) -> None:
        """``cell``: 1 to 32 of a-z, 0-9, dash and underscore, beginning with a letter or digit."""
        if not _CELL.match(cell):
            raise TreenailError(f"cell: expected 1 to 32 of a-z 0-9 - _, not beginning with - or _, got {cell[:40]!r}")
        self.cell = cell

    def of(self, name: str) -> str:
        """Return the full key of a name in this cell."""
        return f"{ROOT}/{self.cell}/{name}"

    def alive(self, service: str) -> str:
        """Key of a service's liveliness token and of its status query."""
        return self.of(name_of(ALIVE, service=service))

    def heartbeat(self, service: str) -> str:
        """Key on which a service's work loop publishes its heartbeat."""
        return self.of(name_of(HEARTBEAT, service=service))

    def run_record(self, run: str) -> str:
        """Key of the RunRecord."""
        return self.of(name_of(RUN, run=run))

    def swaps(self, run: str) -> str:
        """Key of the swaps of a run; there is none before the first."""
        return self.of(name_of(SWAPS, run=run))

    def journal(self, run: str, episode: int) -> str:
        """Key of one episode in the journal."""
        return self.of(name_of(ENTRY, run=run, episode=episode))

    def journal_latest(self, run: str) -> str:
        """Key of the newest episode in the journal."""
        return self.of(name_of(NEWEST_ENTRY, run=run))

    def checkpoint(self, run: str, service: str, episode: int) -> str:
        """Key of one checkpoint."""
        return self.of(name_of(CHECKPOINT, run=run, service=service, episode=episode))

    def checkpoint_latest(self, run: str, service: str) -> str:
        """Key of a worker's newest checkpoint."""
        return self.of(name_of(NEWEST_CHECKPOINT, run=run, service=service))

    def skill(self, sha256: str) -> str:
        """Key of a skill; ``LATEST`` for the one that the next run begins with."""
        return self.of(name_of(SKILL, sha256=sha256))
