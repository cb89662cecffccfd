"""What was learnt in a run that a store knows, rebuilt from its checkpoints and journal."""

from __future__ import annotations

from collections.abc import Iterator

from experiments.lab.skills import skill_after
from services.cell.client import Client
from services.cell.stored import WITHIN_S, StoredRun, checkpoints, samples, skill_named
from services.rules.skill import NamedSkill
from services.wire.codec import contract_sha256
from services.wire.errors import CellError
from services.wire.keys import ENTRY, JOURNAL_BLOCK, SWAPS, WORKERS, name_of
from services.wire.messages import Checkpoint, JournalEpisode, Swaps


def learnt(client: Client, run: StoredRun, episode: int | None = None) -> NamedSkill:
    """Return what was learnt in a run before an episode, by default in all its episodes.

    Raises TreenailError when the journal does not go so far, or the store has forgotten what is needed for it.
    """
    record, ours = run.record, contract_sha256()
    if record.contract_sha256 != ours:
        raise CellError(f"run {record.run}: expected contract {ours[:12]}, got {record.contract_sha256[:12]}")
    until = run.episodes if episode is None else episode
    if not 0 <= until <= run.episodes:
        raise CellError(f"--episode: expected 0 to {run.episodes}, where run {record.run} stands, got {until}")
    began_with = None if record.skill_sha256 is None else skill_named(client, record.skill_sha256)
    starts: dict[str, Checkpoint] = {}
    for service in WORKERS:
        for stored in checkpoints(client, record.run, service):
            if stored.checkpoint.episode <= until:
                starts[service] = stored.checkpoint
    first = min((starts[service].episode if service in starts else 0 for service in WORKERS), default=0)
    journal = list(_episodes(client, record.run, first, until))
    # After the episodes, so that none has a swap that is not among them.
    found = [client.message(sample, Swaps).swaps for sample in samples(client, name_of(SWAPS, run=record.run))]
    swaps = found[0] if found else ()

    return skill_after(record, until, starts, journal, began_with, swaps)


def _episodes(client: Client, run: str, first: int, until: int) -> Iterator[JournalEpisode]:
    for block in range(first // JOURNAL_BLOCK, -(-until // JOURNAL_BLOCK)):
        for entry in client.ask_all(name_of(ENTRY, run=run, block=block), JournalEpisode, WITHIN_S):
            if first <= entry.episode < until:
                yield entry
