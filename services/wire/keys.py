"""Key expressions: everything of one cell lives under ``treenail/<cell>/``. docs/contract.md is generated from here."""

from __future__ import annotations

import re

from services.wire.errors import TreenailError

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
EXPERIMENT = "experiment"
TASK_STEPS = "task/steps"
SWAP = "swap"
SWAPS = "all-swaps"
TRUTH = "sim/truth"
Q_TABLE = "agent/q_table"
POLICY = "agent/policy"
CLASSIFIER_STATES = "classifier/states"
CLASSIFY = "classifier/classify"
SKILL = "checkpoint/skill"
LATEST = "latest"

CONTRACT: tuple[tuple[str, str, str, str, str], ...] = (
    (FT, "pub", "sensor_jr3 or sim -> task, viewer", "FtPacket", "what the wrist feels"),
    (OBSERVATION, "pub", "task -> classifier", "Observation", "an F/T sample to classify, in contact only"),
    (STATE, "pub", "classifier -> agent, viewer", "State", "its contact state"),
    (ACTION, "pub", "agent -> task, viewer", "Action", "what to do in that state"),
    (REWARD, "pub", "task -> agent, viewer", "Reward", "what came of it"),
    (EPISODE, "pub", "task -> everyone", "EpisodeSummary", "one finished episode"),
    (MOVE, "query", "task -> robot_link or sim", "Move -> Moved", "one increment"),
    (HOME, "query", "task -> robot_link or sim", "Home -> Moved", "to the start pose of an episode"),
    (EXPERIMENT, "query", "anyone -> task", "Experiment", "what runs, and how far it is"),
    (
        SWAP,
        "query",
        "operator -> task",
        "SwapRequest -> Swapped",
        "another classifier, learner or policy from an episode on",
    ),
    (TASK_STEPS, "query", "workers -> task", "JournalEpisode", "the decisions of the episode under way"),
    (Q_TABLE, "query", "anyone -> agent", "QTable", "all action values"),
    (POLICY, "query", "anyone -> agent", "PolicyAnswer", "`?state=7` or `?ft=fx,fy,fz,tx,ty,tz`: values, best action"),
    (CLASSIFIER_STATES, "query", "anyone -> classifier", "ClassifierStates", "prototypes and counts"),
    (CLASSIFY, "query", "anyone -> classifier", "Classified", "`?ft=fx,fy,fz,tx,ty,tz` [N, N m]: its contact state"),
    (TRUTH, "pub", "sim -> viewer", "Truth", "the true pose, some 30 times a second; never seen by a learner"),
    ("journal/<run>/run", "put, query", "task <-> store", "RunRecord", "what the run is"),
    ("journal/<run>/<block>/<episode>", "put, query", "task <-> store", "JournalEpisode", "one episode"),
    (f"journal/<run>/{SWAPS}", "put, query", "task <-> store", "Swaps", "what was swapped, and from which episode on"),
    ("journal/<run>/latest", "put, query", "task <-> store", "JournalEpisode", "the newest episode once more"),
    ("checkpoint/<run>/<service>/<episode>", "put, query", "workers <-> store", "Checkpoint", "memory before it"),
    ("checkpoint/<run>/<service>/latest", "put, query", "workers <-> store", "Checkpoint", "the newest once more"),
    (f"{SKILL}/<sha256>", "put, query", "anyone <-> store", "Skill", "a learnt skill, named by its hash"),
    (f"{SKILL}/latest", "put, query", "anyone <-> store, task", "Skill", "the one that the next run begins with"),
    ("alive/<service>", "liveliness, query", "each service", "Alive", "who is here"),
    ("claim/<service>/<instance>", "liveliness", "each service", "-", "who holds a role: one per cell"),
    ("heartbeat/<service>", "pub", "each service", "Alive", "once a second, from the work loop"),
)

_CELL = re.compile(r"^[a-z0-9][a-z0-9_-]{0,31}\Z")


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
        return self.of(f"alive/{service}")

    def heartbeat(self, service: str) -> str:
        """Key on which a service's work loop publishes its heartbeat."""
        return self.of(f"heartbeat/{service}")

    def run_record(self, run: str) -> str:
        """Key of the RunRecord."""
        return self.of(f"journal/{run}/run")

    def swaps(self, run: str) -> str:
        """Key of the swaps of a run; there is none before the first."""
        return self.of(f"journal/{run}/{SWAPS}")

    def journal(self, run: str, episode: int) -> str:
        """Key of one episode in the journal."""
        return self.of(f"journal/{run}/{episode // JOURNAL_BLOCK:06d}/{episode:08d}")

    def journal_block(self, run: str, block: int) -> str:
        """Key expression of all episodes of one block of the journal."""
        return self.of(f"journal/{run}/{block:06d}/*")

    def journal_latest(self, run: str) -> str:
        """Key of the newest episode in the journal."""
        return self.of(f"journal/{run}/{LATEST}")

    def checkpoint(self, run: str, service: str, episode: int) -> str:
        """Key of one checkpoint."""
        return self.of(f"checkpoint/{run}/{service}/{episode:08d}")

    def checkpoint_latest(self, run: str, service: str) -> str:
        """Key of a worker's newest checkpoint."""
        return self.of(f"checkpoint/{run}/{service}/{LATEST}")

    def skill(self, sha256: str) -> str:
        """Key of a skill; ``LATEST`` for the one that the next run begins with."""
        return self.of(f"{SKILL}/{sha256}")
