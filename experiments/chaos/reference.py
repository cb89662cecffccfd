"""What a disturbed run has to equal: the same run in one process, without network, that nobody disturbed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from services.rules.results import Digests, RunResult, episodes_digest
from services.wire.definition import Definition
from services.wire.messages import JournalEpisode, Swap


class Reference(NamedTuple):
    """A run left in peace."""

    result: RunResult
    journal: tuple[JournalEpisode, ...]
    """Every decision of it."""


class Verdict(NamedTuple):
    """How a disturbed run compares."""

    equal: bool
    """Whether all digests are equal."""
    lost_steps: int
    """Decisions of the reference that the journal does not hold, or holds otherwise."""


def undisturbed(definition: Definition, seed: int, episodes: int, swaps: Sequence[Swap] = ()) -> Reference:
    """Run in this process, making swaps on the way, and return what it gave."""
    # Physics and compiled kernels are loaded where they are used: the command would only start more slowly.
    from experiments.lab.in_process import InProcessRun

    run = InProcessRun(definition, seed, swaps=swaps)
    summaries, journal = [], []
    for summary in run.episodes(episodes):
        summaries.append(summary)
        journal.append(run.task.record())
    digests: Digests = {
        "q_table": run.agent.learner.digest(),
        "art2": run.classifier.network.digest(),
        "episodes": episodes_digest(summaries),
    }
    return Reference(RunResult(seed, tuple(summaries), digests), tuple(journal))


def compare(result: RunResult, journal: Sequence[JournalEpisode], reference: Reference) -> Verdict:
    """Return how a run compares with its reference, digests and every single decision."""
    kept = {entry.episode: entry for entry in journal}
    lost = 0
    for entry in reference.journal:
        there = kept[entry.episode].steps if entry.episode in kept else ()
        same = sum(ours == theirs for ours, theirs in zip(entry.steps, there, strict=False))
        lost += len(entry.steps) - same
    return Verdict(result.digests == reference.result.digests, lost)
