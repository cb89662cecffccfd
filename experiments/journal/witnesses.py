"""What else knows of a run's memory, held against the memory rebuilt from its journal. Pure.

Checkpoints and ``summary.json`` stand between two episodes; a living worker stands wherever it is just now, which its
policy version or its number of decisions tells.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from experiments.journal.replay import Replay, begin
from services.agent.fold import AgentFold
from services.cell.stored import StoredCheckpoint
from services.classifier.fold import ClassifierFold
from services.rules.results import Digests, RunResult, RunSummary, episodes_digest, run_summary
from services.rules.skill import NamedSkill
from services.wire.codec import encode
from services.wire.errors import DivergedError
from services.wire.keys import LATEST, NEWEST_ENTRY, name_of
from services.wire.messages import Checkpoint, ClassifierStates, JournalEpisode, QTable, RunRecord, Swap

PARTS = {"agent": "q_table", "classifier": "art2"}
"""What each worker remembers, as ``summary.json`` calls it."""


class Compared(NamedTuple):
    """One thing that was held against the rebuilt memory."""

    witness: str
    """Who else knows."""
    part: str
    """q_table, art2, episodes, entry: SHA-256 in hex; or the name of a number in a checkpoint or ``summary.json``."""
    place: str
    """Where in the run."""
    rebuilt: str | None
    """None when the journal does not go so far."""
    found: str
    equal: bool | None
    """None when it cannot be said, as with a worker that is in an episode which is not in the journal yet."""


class Witnesses(NamedTuple):
    """All that else knows of a run."""

    checkpoints: Sequence[StoredCheckpoint] = ()
    summary: RunSummary | None = None
    table: QTable | None = None
    """Of the living agent."""
    states: ClassifierStates | None = None
    """Of the living classifier."""
    newest: JournalEpisode | None = None
    """The newest episode, as the store has it once more."""

    def replay(self, record: RunRecord, began_with: NamedSkill | None, swaps: Sequence[Swap] = ()) -> Replay:
        """Return a replay that keeps what is needed for ``compared``."""
        episodes = {found.checkpoint.episode for found in self.checkpoints}
        if self.summary is not None:
            episodes.add(self.summary["episodes"])
        return Replay(
            record,
            began_with,
            swaps,
            at_episodes=episodes,
            at_versions=() if self.table is None else (self.table.policy_version,),
            at_decisions=() if self.states is None else (self.states.decisions,),
            entry=None if self.newest is None else self.newest.episode,
        )

    def compared(self, replay: Replay, began_with: NamedSkill | None, until: int | None) -> list[Compared]:
        """Hold each against a replay of all episodes before ``until``, by default of the whole journal."""
        found: list[Compared] = []
        for name, checkpoint, _ in self.checkpoints:
            if until is None or checkpoint.episode <= until:
                found += _checkpoint(replay, began_with, name, checkpoint)
        if self.summary is not None and (until is None or self.summary["episodes"] <= until):
            found += _summary(replay, self.summary)
        if self.newest is not None and (until is None or self.newest.episode < until):
            rebuilt = None if replay.entry is None else _digest(replay.entry)
            name = name_of(NEWEST_ENTRY, run=replay.record.run)
            digest = _digest(self.newest)
            found.append(Compared(name, "entry", f"episode {self.newest.episode}", rebuilt, digest, rebuilt == digest))
        if self.table is not None:
            version = self.table.policy_version
            at_version = replay.q_table_at.get(version, {})
            rebuilt = at_version.get(self.table.decisions, next(iter(at_version.values()), None))
            found.append(_living("agent", f"at version {version}", rebuilt, self.table.digest))
        if self.states is not None:
            decisions = self.states.decisions
            rebuilt = replay.art2_at.get(decisions)
            found.append(_living("classifier", f"after decision {decisions - 1}", rebuilt, self.states.digest))
        return found

    def alone(self, replay: Replay, compared: Sequence[Compared]) -> int:
        """Return of how many episodes the summaries stand in the journal alone, so that some of it is only bounded."""
        told = any(one.part == "episodes" and one.equal for one in compared)
        return replay.episodes - (self.summary["episodes"] if self.summary is not None and told else 0)


def _checkpoint(replay: Replay, began_with: NamedSkill | None, name: str, checkpoint: Checkpoint) -> Iterator[Compared]:
    """Restore a checkpoint as a worker does, and hold it against the memory before its episode."""
    record, part = replay.record, PARTS.get(checkpoint.service, "checkpoint")
    place, moment = f"before episode {checkpoint.episode}", replay.moments.get(checkpoint.episode)
    fold: AgentFold | ClassifierFold
    if checkpoint.service == "agent":
        fold = AgentFold(record.definition, record.run, record.seed, replay.swaps)
    else:
        fold = ClassifierFold(record.definition, record.run, replay.swaps)
    if began_with is not None:
        begin(fold, began_with)
    try:
        _check_belongs(record, name, checkpoint)
        fold.restore(checkpoint.snapshot)
    except (ValueError, DivergedError) as error:
        yield Compared(name, part, place, None, f"cannot be restored: {error}", False)
        return
    digest = fold.learner.digest() if isinstance(fold, AgentFold) else fold.network.digest()
    if moment is None:
        # A worker may put its checkpoint before the journal has the episode, but no two episodes before.
        yield Compared(name, part, place, None, digest, None if checkpoint.episode == replay.episodes + 1 else False)
        return
    rebuilt = moment.q_table if checkpoint.service == "agent" else moment.art2
    yield Compared(name, part, place, rebuilt, digest, rebuilt == digest)
    snapshot = moment.snapshots[checkpoint.service]
    others = {
        field: (snapshot.get(field), checkpoint.snapshot.get(field)) for field in {*snapshot, *checkpoint.snapshot}
    }
    others["decisions"] = (moment.decisions, checkpoint.decisions)
    for field, (wanted, got) in sorted(others.items()):
        if wanted != got and not isinstance(wanted, bytes):  # of bytes, the digest has said it
            yield Compared(name, field, place, str(wanted), str(got), False)


def _check_belongs(record: RunRecord, name: str, checkpoint: Checkpoint) -> None:
    """Raise DivergedError when a checkpoint is not what its name in the store says, or of another contract."""
    folder, _, number = name.rpartition("/")
    agree = (
        ("run", record.run, checkpoint.run),
        ("name", f"{checkpoint.run}/{checkpoint.service}", "/".join(folder.split("/")[-2:])),
        ("episode", checkpoint.episode if number == LATEST else int(number), checkpoint.episode),
        ("contract", record.contract_sha256, checkpoint.contract_sha256),
    )
    for what, expected, got in agree:
        if expected != got:
            raise DivergedError(f"{what}: expected {expected}, got {got}")


def _summary(replay: Replay, summary: RunSummary) -> Iterator[Compared]:
    """Hold the digests against the memory, and every figure against what the journal's summaries make of it."""
    episodes, found = summary["episodes"], summary["digests"]
    place, moment = f"before episode {episodes}", replay.moments.get(episodes)
    if moment is None or not episodes:
        for part, digest in found.items():
            yield Compared("summary.json", part, place, None, str(digest), False)
        return
    log = tuple(replay.summaries[:episodes])
    rebuilt: Digests = {"q_table": moment.q_table, "art2": moment.art2, "episodes": episodes_digest(log)}
    for part, digest in rebuilt.items():
        yield Compared("summary.json", part, place, str(digest), str(found.get(part)), digest == found.get(part))
    figures = run_summary(RunResult(replay.record.seed, log, rebuilt))
    for name, figure in figures.items():
        if name != "digests" and figure != summary.get(name):
            yield Compared("summary.json", name, place, str(figure), str(summary.get(name)), False)


def _digest(entry: JournalEpisode) -> str:
    return hashlib.sha256(encode(entry)).hexdigest()


def _living(service: str, place: str, rebuilt: str | None, found: str) -> Compared:
    equal = None if rebuilt is None else rebuilt == found
    return Compared(f"{service}, living", PARTS[service], place, rebuilt, found, equal)
