"""The results of a run in its cell: fetched, checked to be complete, written, and told to people."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from rich.table import Table

from experiments.lab.learnt import learnt
from experiments.lab.plots import figures
from experiments.lab.result_files import SKILL, write
from experiments.lab.skills import digests
from services.cell.client import Client
from services.cell.ended import EndedRun, finished_episodes, result_of
from services.cell.stored import InCell, StoredRun
from services.rules.results import STEADY_EPISODES, RunResult, RunSummary, episodes_digest, summary
from services.rules.skill import NamedSkill
from services.wire.definition_file import definition_sha256
from services.wire.errors import TreenailError


class Finished(NamedTuple):
    """What was written of a run."""

    summary: RunSummary
    skill: Path | None
    """File of what was learnt."""
    trouble: str | None = None
    """Why there is none."""


FILES = "summary.json, episodes.csv, return.png, force.png, torque.png, failures.png"


def finish(client: Client, ended: EndedRun, out: Path, mind: Callable[[], None]) -> Finished:
    """Write the results of a finished run into ``out``; ``mind`` is called while waiting.

    Raises CellError when the store's journal or the workers' memory does not become complete.
    """
    result = result_of(client, ended, mind)
    try:
        skill, trouble = learnt(StoredRun(InCell(client), ended.run), ended.episodes), None
    except TreenailError as error:  # the results are not given up for it
        skill, trouble = None, str(error)
    return _write(out, ended, result, skill)._replace(trouble=trouble)


def finish_early(client: Client, run: EndedRun, planned: int, out: Path) -> Finished | None:
    """Write the results of the episodes that a run under way, of ``planned``, has finished so far.

    Returns None when there are none. What was learnt in them is folded anew: the workers are ahead already. Raises
    TreenailError when the store does not have all that is needed for it.
    """
    episodes = finished_episodes(client, run.run)
    if not episodes:
        return None
    skill = learnt(StoredRun(InCell(client), run.run), len(episodes))
    result = RunResult(run.seed, episodes, {**digests(skill.skill), "episodes": episodes_digest(episodes)})
    return _write(out, run, result, skill, None if len(episodes) == planned else planned)


def results_table(run: RunSummary, name: str) -> Table:
    """Return what people want to know of a run first."""
    table = Table(title=f"{name}, seed {run['seed']}: {run['episodes']} episodes")
    for heading in ("", "first 10", "last quarter"):
        table.add_column(heading, justify="right" if heading else "left")
    first, last = run["first_10"], run["last_quarter"]
    table.add_row("return", f"{first['return']:.1f}", f"{last['return']:.1f}")
    table.add_row("mean force [N]", f"{first['force_n']:.2f}", f"{last['force_n']:.2f}")
    table.add_row("mean torque [N·m]", f"{first['torque_nm']:.3f}", f"{last['torque_nm']:.3f}")
    table.add_row("success", f"{first['success']:.1%}", f"{last['success']:.1%}")
    return table


def results_line(run: RunSummary) -> str:
    """Return the rest of it, in a line: whether it became steady, and how often it collided."""
    if run["episodes"] < STEADY_EPISODES:
        steady = f"steady: it takes {STEADY_EPISODES} episodes to tell, there are {run['episodes']}"
    elif run["steady_from"] is None:
        steady = "steady not yet"
    else:
        steady = f"steady from episode {run['steady_from']}"
    return f"{steady}; {run['collisions']} collisions; {run['states']} contact states"


def _write(
    out: Path, run: EndedRun, result: RunResult, skill: NamedSkill | None, interrupted_of: int | None = None
) -> Finished:
    swaps = [swap for swap in run.swaps if swap.episode < len(result.episodes)]
    results = summary(run.definition, definition_sha256(run.definition), [result], swaps)
    if interrupted_of is not None:
        results["interrupted"] = {"seeds": [run.seed], "episodes": interrupted_of}
    out.mkdir(parents=True, exist_ok=True)
    drawn = figures(run.definition.name, {run.seed: result.episodes})
    write(out, run.definition, results, [result], drawn, {} if skill is None else {run.seed: skill})
    return Finished(results["runs"][0], None if skill is None else out / SKILL.format(run.seed))
