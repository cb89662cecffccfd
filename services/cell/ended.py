"""What a run that is over left in its cell: fetched, and checked to be complete."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple, TypeVar

from services.cell.client import Client
from services.rules.results import RunResult, episodes_digest
from services.wire.definition import Definition
from services.wire.errors import CellError, ContractError
from services.wire.keys import CLASSIFIER_STATES, ENTRY, Q_TABLE, name_of
from services.wire.messages import ClassifierStates, EpisodeSummary, JournalEpisode, QTable, Swap

T = TypeVar("T")

SETTLE_S = 60.0
"""How long the workers get to reach the last decision; a restarted one replays its journal first."""


class EndedRun(NamedTuple):
    """A run that is over."""

    run: str
    definition: Definition
    seed: int
    episodes: int
    first_version: int
    """Learning updates in the skill that it began with."""
    swaps: tuple[Swap, ...] = ()
    """What was swapped in the course of it."""


def result_of(client: Client, ended: EndedRun, mind: Callable[[], None]) -> RunResult:
    """Return what a finished run left, checked to be complete; ``mind`` is called while waiting.

    Raises CellError when the store's journal or the workers' memory does not become complete.
    """
    episodes = _once_settled(lambda: _episodes(client, ended.run, ended.episodes), mind)
    decisions = sum(summary.decisions for summary in episodes)
    q_digest, art2_digest = _once_settled(lambda: _digests(client, ended, decisions), mind)
    return RunResult(
        ended.seed, episodes, {"q_table": q_digest, "art2": art2_digest, "episodes": episodes_digest(episodes)}
    )


def finished_episodes(client: Client, run: str) -> tuple[EpisodeSummary, ...]:
    """Return the summaries of all episodes that a run, perhaps under way, has finished, from the first on.

    Raises CellError when the journal has a gap.
    """
    entries = client.ask_all(name_of(ENTRY, run=run), JournalEpisode, timeout_s=30.0)
    summaries = tuple(entry.summary for entry in entries if entry.summary is not None)
    if [summary.episode for summary in summaries] != list(range(len(summaries))):
        raise CellError(f"journal: expected episodes from 0 on without a gap, got {len(summaries)} episodes with gaps")
    return summaries


def _once_settled(attempt: Callable[[], T], mind: Callable[[], None]) -> T:
    """Return what ``attempt`` gives once it succeeds: any process may be just starting again."""
    deadline = time.monotonic() + SETTLE_S
    while True:
        mind()
        try:
            return attempt()
        except (CellError, ContractError):
            if time.monotonic() > deadline:
                raise
        time.sleep(0.1)


def _episodes(client: Client, run: str, count: int) -> tuple[EpisodeSummary, ...]:
    """Return the summaries of all episodes, checked to be complete."""
    summaries = finished_episodes(client, run)
    if len(summaries) != count:
        raise CellError(f"journal: expected episodes 0 to {count - 1} without a gap, got {len(summaries)} episodes")
    return summaries


def _digests(client: Client, ended: EndedRun, decisions: int) -> tuple[str, str]:
    """Return the digests of Q-table and ART2 weights, checked to be those after all decisions."""
    table = client.ask(Q_TABLE, QTable)
    states = client.ask(CLASSIFIER_STATES, ClassifierStates)
    learnt = table.policy_version - ended.first_version
    if {table.run, states.run} != {ended.run}:
        raise CellError(f"workers: expected run {ended.run}, got {table.run} and {states.run}")
    if not learnt == table.decisions == states.decisions == decisions:
        got = f"agent {learnt} and classifier {states.decisions}"
        raise CellError(f"workers: expected all {decisions} decisions to be learnt, got {got}")
    return table.digest, states.digest
