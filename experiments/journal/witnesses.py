"""What else knows of a run's memory, held against the memory rebuilt from its journal. Pure.

Checkpoints and ``summary.json`` stand between two episodes; a living worker stands wherever it is just now, which its
policy version or its number of decisions tells.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from experiments.journal.replay import Replay, begin
from services.agent.fold import AgentFold
from services.classifier.fold import ClassifierFold
from services.rules.results import RunSummary, episodes_digest
from services.rules.skill import NamedSkill
from services.wire.errors import DivergedError
from services.wire.messages import Checkpoint, ClassifierStates, QTable, RunRecord, Swap

PARTS = {"agent": "q_table", "classifier": "art2"}
"""What each worker remembers, as ``summary.json`` calls it."""


class Compared(NamedTuple):
    """One thing that was held against the rebuilt memory."""

    witness: str
    """Who else knows."""
    part: str
    """q_table, art2 or episodes: SHA-256 in hex; or decisions: how many were taken before."""
    place: str
    """Where in the run."""
    rebuilt: str | None
    """None when the journal does not go so far."""
    found: str
    equal: bool | None
    """None when it cannot be said, as with a worker that is in an episode which is not in the journal yet."""


class Witnesses(NamedTuple):
    """All that else knows of a run."""

    checkpoints: Sequence[tuple[str, Checkpoint]] = ()
    """With their names in the store."""
    summary: RunSummary | None = None
    table: QTable | None = None
    """Of the living agent."""
    states: ClassifierStates | None = None
    """Of the living classifier."""

    def replay(self, record: RunRecord, began_with: NamedSkill | None, swaps: Sequence[Swap] = ()) -> Replay:
        """Return a replay that keeps what is needed for ``compared``."""
        episodes = {checkpoint.episode for _, checkpoint in self.checkpoints}
        if self.summary is not None:
            episodes.add(self.summary["episodes"])
        return Replay(
            record,
            began_with,
            swaps,
            at_episodes=episodes,
            at_versions=() if self.table is None else (self.table.policy_version,),
            at_decisions=() if self.states is None else (self.states.decisions,),
        )

    def compared(self, replay: Replay, began_with: NamedSkill | None, until: int | None) -> list[Compared]:
        """Hold each against a replay of all episodes before ``until``, by default of the whole journal."""
        found: list[Compared] = []
        for name, checkpoint in self.checkpoints:
            if until is None or checkpoint.episode <= until:
                found += _checkpoint(replay, began_with, name, checkpoint)
        if self.summary is not None and (until is None or self.summary["episodes"] <= until):
            found += _summary(replay, self.summary)
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


def _checkpoint(replay: Replay, began_with: NamedSkill | None, name: str, checkpoint: Checkpoint) -> Iterator[Compared]:
    """Restore a checkpoint as a worker does, and hold it against the memory before its episode."""
    record, part = replay.record, PARTS.get(checkpoint.service)
    if part is None:
        return
    place, moment = f"before episode {checkpoint.episode}", replay.moments.get(checkpoint.episode)
    fold: AgentFold | ClassifierFold
    if checkpoint.service == "agent":
        fold = AgentFold(record.definition, record.run, record.seed, replay.swaps)
    else:
        fold = ClassifierFold(record.definition, record.run, replay.swaps)
    if began_with is not None:
        begin(fold, began_with)
    try:
        if checkpoint.run != record.run:
            raise DivergedError(f"of run {checkpoint.run}")
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
    for decisions in {fold.decisions, checkpoint.decisions} - {moment.decisions}:
        yield Compared(name, "decisions", place, str(moment.decisions), str(decisions), False)


def _summary(replay: Replay, summary: RunSummary) -> Iterator[Compared]:
    episodes, digests = summary["episodes"], summary["digests"]
    place, moment = f"before episode {episodes}", replay.moments.get(episodes)
    log = None if moment is None else episodes_digest(replay.summaries[:episodes])
    rows = (
        ("q_table", None if moment is None else moment.q_table, digests["q_table"]),
        ("art2", None if moment is None else moment.art2, digests["art2"]),
        ("episodes", log, digests["episodes"]),
    )
    for part, rebuilt, found in rows:
        yield Compared("summary.json", part, place, rebuilt, found, rebuilt == found)


def _living(service: str, place: str, rebuilt: str | None, found: str) -> Compared:
    equal = None if rebuilt is None else rebuilt == found
    return Compared(f"{service}, living", PARTS[service], place, rebuilt, found, equal)
