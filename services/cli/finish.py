"""The end of a run: fetch what it left, check that it is complete, write results and say how it went."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.table import Table

from experiments.plots import figures
from experiments.result_files import write
from experiments.results import RunResult, RunSummary, episodes_digest, summary
from services.cli.client import Client
from services.wire.definition import Definition
from services.wire.definition_file import definition_sha256
from services.wire.errors import CellError, ContractError, NoAnswerError, RefusedError
from services.wire.keys import CLASSIFIER_STATES, Q_TABLE
from services.wire.messages import ClassifierStates, EpisodeSummary, JournalEpisode, QTable

SETTLE_S = 60.0
"""How long the workers get to reach the last decision; a restarted one replays its journal first."""


def finish(
    client: Client,
    definition: Definition,
    seed: int,
    run: str,
    out: Path,
    mind: Callable[[], None],
    say: Callable[[str], None],
) -> None:
    """Write the results of a finished run into ``out``; ``mind`` is called while waiting.

    Raises CellError when the store's journal or the workers' memory is not complete.
    """
    entries = client.ask_all(f"journal/{run}/*/*", JournalEpisode, timeout_s=30.0)
    episodes = _complete(entries)
    decisions = sum(len(entry.steps) for entry in entries)
    q_digest, art2_digest = _digests(client, decisions, mind)
    result = RunResult(
        seed, episodes, {"q_table": q_digest, "art2": art2_digest, "episodes": episodes_digest(episodes)}
    )
    results = summary(definition, definition_sha256(definition), [result])
    write(out, definition, results, [result], figures(definition.name, {seed: episodes}))
    _print(results["runs"][0], definition.name)
    say(f"results in {out}: summary.json, episodes.csv, return.png, force.png, torque.png, failures.png")


def _complete(entries: list[JournalEpisode]) -> tuple[EpisodeSummary, ...]:
    """Return the summaries of all episodes, checked to be without gaps."""
    summaries = tuple(entry.summary for entry in entries if entry.summary is not None)
    if [entry.episode for entry in entries] != list(range(len(summaries))):
        raise CellError(f"journal: expected episodes 0 to {len(entries) - 1} without a gap, got {len(summaries)}")
    return summaries


def _digests(client: Client, decisions: int, mind: Callable[[], None]) -> tuple[str, str]:
    """Return the digests of Q-table and ART2 weights, once both have folded all decisions."""
    deadline = time.monotonic() + SETTLE_S
    while True:
        mind()
        try:
            table = client.ask(Q_TABLE, QTable)
            states = client.ask(CLASSIFIER_STATES, ClassifierStates)
            if table.policy_version == table.decisions == states.decisions == decisions:
                return table.digest, states.digest
            got = f"agent {table.policy_version} and classifier {states.decisions}"
        except (NoAnswerError, RefusedError, ContractError) as error:
            got = str(error)
        if time.monotonic() > deadline:
            raise CellError(f"workers: expected all {decisions} decisions to be learnt, got {got}")
        time.sleep(0.1)


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
    steady = "never" if run["steady_from"] is None else f"episode {run['steady_from']}"
    console.print(
        f"steady from {steady}; {run['collisions']} collisions; {run['states']} contact states", highlight=False
    )
