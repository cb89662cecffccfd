"""The end of a run: fetch what it left, check that it is complete, write results and say how it went."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, TypeVar

from rich.console import Console
from rich.table import Table

from experiments.plots import figures
from experiments.result_files import write
from experiments.results import RunResult, RunSummary, episodes_digest, summary
from services.cli.client import Client
from services.wire.definition import Definition
from services.wire.definition_file import definition_sha256
from services.wire.errors import CellError, ContractError
from services.wire.keys import CLASSIFIER_STATES, Q_TABLE
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


def finish(client: Client, ended: EndedRun, out: Path, mind: Callable[[], None], say: Callable[[str], None]) -> None:
    """Write the results of a finished run into ``out``; ``mind`` is called while waiting.

    Raises CellError when the store's journal or the workers' memory does not become complete.
    """
    definition, result = ended.definition, result_of(client, ended, mind)
    swaps = [swap for swap in ended.swaps if swap.episode < ended.episodes]
    results = summary(definition, definition_sha256(definition), [result], swaps)
    write(out, definition, results, [result], figures(definition.name, {result.seed: result.episodes}))
    _print(results["runs"][0], definition.name)
    say(f"results in {out}: summary.json, episodes.csv, return.png, force.png, torque.png, failures.png")


def result_of(client: Client, ended: EndedRun, mind: Callable[[], None]) -> RunResult:
    """Return what a finished run left, checked to be complete; ``mind`` is called while waiting.

    Raises CellError when the store's journal or the workers' memory does not become complete.
    """
    episodes = _settled(lambda: _episodes(client, ended.run, ended.episodes), mind)
    decisions = sum(summary.decisions for summary in episodes)
    q_digest, art2_digest = _settled(lambda: _digests(client, ended, decisions), mind)
    return RunResult(
        ended.seed, episodes, {"q_table": q_digest, "art2": art2_digest, "episodes": episodes_digest(episodes)}
    )


def _settled(attempt: Callable[[], T], mind: Callable[[], None]) -> T:
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
    entries = client.ask_all(f"journal/{run}/*/*", JournalEpisode, timeout_s=30.0)
    found = tuple(entry.summary for entry in entries if entry.summary is not None)
    if [summary.episode for summary in found] != list(range(count)):
        raise CellError(f"journal: expected episodes 0 to {count - 1} without a gap, got {len(found)} episodes")
    return found


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


def _print(run: RunSummary, name: str) -> None:
    table = Table(title=f"{name}, seed {run['seed']}: {run['episodes']} episodes")
    for heading in ("", "first 10", "last quarter"):
        table.add_column(heading, justify="right" if heading else "left")
    first, last = run["first_10"], run["last_quarter"]
    table.add_row("return", f"{first['return']:.1f}", f"{last['return']:.1f}")
    table.add_row("mean force [N]", f"{first['force_n']:.2f}", f"{last['force_n']:.2f}")
    table.add_row("mean torque [N·m]", f"{first['torque_nm']:.3f}", f"{last['torque_nm']:.3f}")
    table.add_row("success", f"{first['success']:.1%}", f"{last['success']:.1%}")
    console = Console()
    console.print(table)
    steady = "not yet" if run["steady_from"] is None else f"from episode {run['steady_from']}"
    console.print(f"steady {steady}; {run['collisions']} collisions; {run['states']} contact states", highlight=False)
