"""Runs of one process with all that the store of a cell would have of them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Protocol

import pytest

from experiments.lab.in_process import InProcessRun
from services.rules.results import Digests, episodes_digest
from services.rules.skill import NamedSkill
from services.store.database import Database
from services.store.values import Put
from services.wire.codec import encode, encoding_of
from services.wire.definition import Definition
from services.wire.keys import Keys
from services.wire.messages import Checkpoint, JournalEpisode, Message, RunRecord

CHECKPOINT_EVERY = 2


class Recorded:
    """A run in this process, its journal, its checkpoints, and the digests before each of its episodes."""

    def __init__(self, definition: Definition, seed: int, episodes: int, began_with: NamedSkill | None) -> None:
        self.began_with = began_with
        self.run = InProcessRun(definition, seed, skill=began_with)
        self.record: RunRecord = self.run.record
        self.journal: list[JournalEpisode] = []
        self.checkpoints: list[Checkpoint] = []
        self.digests: list[Digests] = [self._digests()]
        for _ in self.run.episodes(episodes):
            self.journal.append(self.run.task.record())
            self.digests.append(self._digests())
            if self.run.episodes_done % CHECKPOINT_EVERY == 0:
                self.checkpoints += self._checkpoints()

    def _digests(self) -> Digests:
        summaries = [entry.summary for entry in self.journal if entry.summary is not None]
        return {
            "q_table": self.run.agent.learner.digest(),
            "art2": self.run.classifier.network.digest(),
            "episodes": episodes_digest(summaries),
        }

    def _checkpoints(self) -> Iterable[Checkpoint]:
        for service, fold in (("agent", self.run.agent), ("classifier", self.run.classifier)):
            yield Checkpoint(
                run=self.run.run,
                service=service,
                episode=self.run.episodes_done,
                decisions=fold.decisions,
                contract_sha256=self.record.contract_sha256,
                snapshot=fold.snapshot(),
            )


class Record(Protocol):
    """Makes runs."""

    def __call__(
        self, definition: Definition, seed: int, episodes: int, began_with: NamedSkill | None = None
    ) -> Recorded:
        """Return a run of so many episodes."""


@pytest.fixture(scope="session")
def record_run() -> Record:
    """Makes runs, each once."""
    known: dict[object, Recorded] = {}

    def make(definition: Definition, seed: int, episodes: int, began_with: NamedSkill | None = None) -> Recorded:
        key = (definition, seed, episodes, None if began_with is None else began_with.sha256)
        if key not in known:
            known[key] = Recorded(definition, seed, episodes, began_with)
        return known[key]

    return make


def puts_of(recorded: Recorded, journal: Iterable[JournalEpisode], cell: str) -> dict[str, Message]:
    """Return what a cell's store would have of a run whose journal is this one."""
    keys, run, entries = Keys(cell), recorded.record.run, list(journal)
    found: dict[str, Message] = {keys.run_record(run): recorded.record}
    found |= {keys.journal(run, entry.episode): entry for entry in entries}
    if entries:
        found[keys.journal_latest(run)] = entries[-1]
    for checkpoint in recorded.checkpoints:
        found[keys.checkpoint(run, checkpoint.service, checkpoint.episode)] = checkpoint
        found[keys.checkpoint_latest(run, checkpoint.service)] = checkpoint
    if recorded.began_with is not None:
        found[keys.skill(recorded.began_with.sha256)] = recorded.began_with.skill
    return found


class Keep(Protocol):
    """Writes stores' files."""

    def __call__(self, path: Path, messages: dict[str, Message]) -> None:
        """Put messages under full keys, over what is there."""


@pytest.fixture(scope="session")
def keep() -> Keep:
    """Writes stores' files, as a store does."""
    clock = itertools.count(1)

    def put(path: Path, messages: dict[str, Message]) -> None:
        rows = [
            Put(key, encode(message), encoding_of(type(message)), f"{next(clock):016x}/{'1' * 32}")
            for key, message in messages.items()
        ]
        with Database(path) as database:
            database.apply(rows)

    return put


@pytest.fixture(scope="session")
def store_of(keep: Keep) -> Callable[..., Path]:
    """Writes the file that a cell's store would have after some runs."""

    def make(path: Path, *recorded: Recorded, cell: str = "a") -> Path:
        for one in recorded:
            keep(path, puts_of(one, one.journal, cell))
        return path

    return make
