"""What a run that is over left in its cell: fetched, and checked to be complete."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

from services.cell.client import Client
from services.rules.results import RunResult, episodes_digest
from services.wire.definition import Definition
from services.wire.errors import CellError, ContractError
from services.wire.keys import CLASSIFIER_STATES, ENTRY, Q_TABLE, name_of
from services.wire.messages import ClassifierStates, EpisodeSummary, JournalEpisode, QTable, Swap
from services.wire.text import spans

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
    numbers = [summary.episode for summary in summaries]
    _check_gaps(run, numbers, max(numbers, default=-1) + 1)
    return summaries


def _check_gaps(run: str, numbers: Sequence[int], count: int) -> None:
    """Raise CellError unless these are the numbers of all episodes of a run of so many."""
    lacking, beyond = set(range(count)) - set(numbers), set(numbers) - set(range(count))
    if lacking or beyond:
        got = f"without {spans(lacking)}" if lacking else f"and {spans(beyond)}"
        what_now = (
            "stop the cell, let `treenail store salvage FILE OUT` cut the run off before the gap, and go on with OUT"
        )
        raise CellError(f"journal of run {run}: expected episodes 0 to {count - 1}, got them {got}; {what_now}")


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
    _check_gaps(run, [summary.episode for summary in summaries], count)
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
