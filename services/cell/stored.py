"""What the store of a cell has: runs, what was learnt in them, and skills."""

from __future__ import annotations

from typing import NamedTuple

import zenoh

from services.cell.client import Client
from services.rules import skill as skills_on_wire
from services.rules.skill import NamedSkill
from services.wire.errors import CellError, ContractError, NoAnswerError, RefusedError
from services.wire.keys import CHECKPOINT, EXPERIMENT, LATEST, NEWEST_ENTRY, RUN, SKILL, name_of, wild
from services.wire.messages import Checkpoint, Experiment, JournalEpisode, RunRecord

WITHIN_S = 30.0
"""How long the store has for an answer that may be large."""


class StoredRun(NamedTuple):
    """A run in the store."""

    record: RunRecord
    newest: JournalEpisode | None
    """Its newest episode."""
    size_bytes: int
    """Size of that episode's journal entry."""
    changed: int
    """When the store was given something of it last, in Zenoh's units; a run that is taken up again counts."""

    @property
    def episodes(self) -> int:
        """Return how many episodes are done."""
        return 0 if self.newest is None else self.newest.episode + 1

    @property
    def decisions(self) -> int:
        """Return how many decisions were taken in these."""
        return 0 if self.newest is None else self.newest.first_decision + len(self.newest.steps)


class StoredCheckpoint(NamedTuple):
    """A checkpoint in the store, and the size of its payload."""

    checkpoint: Checkpoint
    size_bytes: int
    newest: bool


class StoredSkills(NamedTuple):
    """The skills in the store by name, with the size of each, and which one the next run begins with."""

    found: dict[str, tuple[NamedSkill, int]]
    chosen: str | None


def runs(client: Client) -> list[StoredRun]:
    """Return the runs in the store, the one that was worked on last first. Raises NoAnswerError without a store.

    Runs that another version of Treenail recorded are left out.
    """
    newest = {_run_in(sample): sample for sample in samples(client, wild(NEWEST_ENTRY))}
    found = []
    for sample in samples(client, wild(RUN)):
        try:
            record = client.message(sample, RunRecord)
            latest = newest.get(record.run)
            entry = None if latest is None else client.message(latest, JournalEpisode)
        except ContractError:
            continue
        size = 0 if latest is None else len(latest.payload.to_bytes())
        found.append(StoredRun(record, entry, size, max(_when(sample), 0 if latest is None else _when(latest))))
    if not found and "store" not in client.alive():
        raise NoAnswerError(f"store: expected one in cell {client.keys.cell!r}, got none")
    return sorted(found, key=lambda run: (run.changed, run.record.run), reverse=True)


def run_named(client: Client, name: str | None) -> StoredRun:
    """Return a run, by default the one that the task works on, or else the one that was worked on last.

    Raises CellError when there is no such run.
    """
    known = runs(client)
    if name is None:
        try:
            name = client.ask(EXPERIMENT, Experiment).run
        except (NoAnswerError, RefusedError):
            name = known[0].record.run if known else None
    for run in known:
        if run.record.run == name:
            return run
    if not known:
        raise CellError(f"store: expected a run in cell {client.keys.cell!r}, got none so far")
    there = ", ".join(run.record.run for run in known[:10])
    raise CellError(f"run: expected one that the store knows ({there}), got {name}")


def checkpoints(client: Client, run: str, service: str) -> list[StoredCheckpoint]:
    """Return the checkpoints of a run and service, oldest first."""
    found: dict[int, StoredCheckpoint] = {}
    for sample in samples(client, name_of(CHECKPOINT, run=run, service=service)):
        checkpoint = client.message(sample, Checkpoint)
        latest = str(sample.key_expr).endswith(f"/{LATEST}")
        known = found.get(checkpoint.episode)
        size = len(sample.payload.to_bytes())
        found[checkpoint.episode] = StoredCheckpoint(checkpoint, size, latest or (known is not None and known.newest))
    return [found[episode] for episode in sorted(found)]


def skills(client: Client) -> StoredSkills:
    """Return the skills in the store; those of another contract are left out."""
    found: dict[str, tuple[NamedSkill, int]] = {}
    chosen = None
    for sample in samples(client, wild(SKILL)):
        payload = sample.payload.to_bytes()
        try:
            skill = skills_on_wire.decode(payload, str(sample.encoding))
        except ContractError:
            continue
        found[skill.sha256] = (skill, len(payload))
        if str(sample.key_expr) == client.keys.skill(LATEST):
            chosen = skill.sha256
    return StoredSkills(found, chosen)


def skill_named(client: Client, prefix: str) -> NamedSkill:
    """Return the one skill in the store whose name begins with ``prefix``. Raises CellError."""
    known = skills(client).found
    fitting = [name for name in known if name.startswith(prefix)]
    if len(fitting) != 1:
        there = ", ".join(name[:12] for name in known) or "none"
        raise CellError(f"skill: expected one that the store knows ({there}), got {prefix[:12]}, {len(fitting)} fit")
    return known[fitting[0]][0]


def samples(client: Client, name: str) -> list[zenoh.Sample]:
    """Return all that the store answers to a key expression. Raises RefusedError."""
    answers, refusals = client.replies(name, WITHIN_S)
    if refusals:
        raise RefusedError(f"{client.keys.of(name)}: {refusals[0]}")
    return answers


def _run_in(sample: zenoh.Sample) -> str:
    """Return the run in a key of the journal."""
    return str(sample.key_expr).split("/")[3]


def _when(sample: zenoh.Sample) -> int:
    return 0 if sample.timestamp is None else int(str(sample.timestamp.get_time_as_ntp64()))
