"""The end of a run: fetch what it left, check that it is complete, write results and say how it went."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.table import Table

from experiments.lab.plots import figures
from experiments.lab.result_files import write
from services.cell.client import Client
from services.cell.ended import EndedRun, result_of
from services.rules.results import RunSummary, summary
from services.wire.definition_file import definition_sha256


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
