"""What was learnt in a run that a store knows, rebuilt from its checkpoints and journal."""

from __future__ import annotations

from experiments.lab.skills import skill_after
from services.cell.stored import StoredRun
from services.rules.skill import NamedSkill
from services.wire.errors import CellError
from services.wire.keys import WORKERS


def learnt(run: StoredRun, episode: int | None = None) -> NamedSkill:
    """Return what was learnt in a run before an episode, by default in all its episodes.

    Raises TreenailError when the journal does not go so far, or the store has forgotten what is needed for it.
    """
    record, length = run.record(), run.length()
    until = length if episode is None else episode
    if not 0 <= until <= length:
        raise CellError(f"--episode: expected 0 to {length}, where run {run.name} stands, got {until}")
    began_with = run.skill(record.skill_sha256)
    early = [found.checkpoint for found in run.checkpoints() if found.checkpoint.episode <= until]
    starts = {checkpoint.service: checkpoint for checkpoint in early}  # the newest of each, as they come oldest first
    first = min(starts[service].episode if service in starts else 0 for service in WORKERS)
    journal = list(run.episodes(until, first))
    # The swaps after the episodes, so that none has a swap that is not among them.
    return skill_after(record, until, starts, journal, began_with, run.swaps())
