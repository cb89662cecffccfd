"""``treenail checkpoint``: list, show, export, import and map what was learnt."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.table import Table

from experiments.journal.options import STORE_HELP, places
from experiments.lab.learnt import learnt
from experiments.lab.skills import digests
from services.cell import client, skill_transfer, stored
from services.cell.stored import OtherContractError, Stored, StoredRun
from services.cell.terminal import console
from services.rules import skill as skill_file
from services.rules.command_line import number, whole
from services.rules.shipped_skill import BUILTIN, for_task, named_or_file
from services.rules.skill import NamedSkill
from services.rules.skill_moves import carried
from services.rules.swaps import in_force, kind_of, words
from services.wire.definition_file import load
from services.wire.errors import CellError, ContractError
from services.wire.keys import LATEST
from services.wire.messages import Experiment

Row = dict[str, str | int | bool | None]

TAKEN_WITHIN_S = 60.0
"""How long the task gets by default to finish its episode and begin another run."""
_IN_STORE = re.compile(r"[0-9a-f]{16}-s[0-9]+.*|[0-9a-f]{4,64}")
"""What names a run, or a skill by its SHA-256 or the beginning of it; anything else is a file."""
_NUMBERS = ("episodes", "decisions", "states", "version", "bytes")
_HEADINGS = ("run", "service", "episodes", "decisions", "bytes", "newest")
_SKILL_HEADINGS = ("skill", "run", "episodes", "states", "version", "bytes", "chosen")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    commands = parser.add_subparsers(metavar="list|show|export|import|map", required=True)
    add = commands.add_parser("list", help="what the store of a cell has")
    add.add_argument("--json", action="store_true", help="as JSON")
    add.set_defaults(command=_list)
    _add_place(add)
    add = commands.add_parser("show", help="what was learnt: in a run, in a file, or a skill in the store")
    add.add_argument(
        "what",
        nargs="?",
        metavar="RUN|FILE|SHA256",
        help=f"{BUILTIN} is the skill that comes with Treenail (default: the run that the cell works on)",
    )
    add.add_argument("--json", action="store_true", help="as JSON")
    add.set_defaults(command=_show)
    _add_place(add)
    add = commands.add_parser("export", help="write what was learnt into one file, for another cell to begin with")
    add.add_argument("file", type=Path, metavar="FILE")
    add.add_argument("--run", help="default: the run that the cell works on, else the last one")
    add.add_argument(
        "--episode", type=whole(0), metavar="E", help="as learnt before episode E (default: in all so far)"
    )
    add.add_argument("--force", action="store_true", help="replace the file if there is one")
    add.set_defaults(command=_export)
    _add_place(add)
    add = commands.add_parser("import", help="let a cell begin a run with a skill; a running one does so at once")
    which = add.add_mutually_exclusive_group(required=True)
    which.add_argument("file", nargs="?", metavar="FILE", help=f"or {BUILTIN}, the skill that comes with Treenail")
    which.add_argument("--none", action="store_true", help="begin with nothing learnt")
    add.add_argument(
        "--timeout",
        type=number(0.0, 1e6, "seconds"),
        default=TAKEN_WITHIN_S,
        metavar="S",
        help=f"seconds to wait for a running task to end its episode (default: {TAKEN_WITHIN_S:g})",
    )
    add.add_argument("--yes", action="store_true", help="give up a run under way without asking")
    add.set_defaults(command=_import)
    client.add_arguments(add)
    add = commands.add_parser("map", help="make of a skill one for a task with other moves: those of one name are kept")
    add.add_argument("file", metavar="FILE", help=f"or {BUILTIN}, the skill that comes with Treenail")
    add.add_argument("out", type=Path, metavar="OUT")
    add.add_argument("--experiment", required=True, metavar="NAME_OR_FILE", help="the task whose moves it is to have")
    add.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="change a setting of that task")
    add.add_argument("--force", action="store_true", help="replace the file if there is one")
    add.set_defaults(command=_map)


def _add_place(parser: argparse.ArgumentParser) -> None:
    """Add the options that say which store: that of a living cell, or a file."""
    parser.add_argument("--store", type=Path, metavar="FILE", help=STORE_HELP)
    client.add_arguments(parser)
    parser.set_defaults(cell=None)  # a file may be of any cell


@contextmanager
def _store(arguments: argparse.Namespace) -> Iterator[Stored]:
    """Give what that store has."""
    with places(arguments, arguments.store) as found:
        if len(found) > 1:
            there = ", ".join(store.where for store in found)
            raise CellError(f"--cell: expected to be told which one of {there}")
        yield found[0]


def act(arguments: argparse.Namespace) -> None:
    """Do one of the five."""
    arguments.command(arguments)


def _export(arguments: argparse.Namespace) -> None:
    if not arguments.force and arguments.file.exists():
        raise skill_file.SkillError(f"{arguments.file}: expected no such file yet; --force replaces it")
    with _store(arguments) as store:
        run = stored.run_named(store, arguments.run)
        until = run.length() if arguments.episode is None else arguments.episode
        found = learnt(run, until)
    skill_file.write(arguments.file, found, force=arguments.force)
    print(
        f"{arguments.file}: skill {found.sha256[:12]} of run {run.name} after episode {until}: "
        f"{found.states} contact states, {found.version} updates"
    )


def _map(arguments: argparse.Namespace) -> None:
    """Write a skill with the moves of another task, which it then fits in all else too."""
    task = load(arguments.experiment, arguments.set)
    made = carried(named_or_file(arguments.file), task)
    skill_file.fits(made.skill.skill, task)
    skill_file.write(arguments.out, made.skill, force=arguments.force)
    print(f"{arguments.out}: skill {made.skill.sha256[:12]} with the moves of {task.name}: {made.text}")


def _import(arguments: argparse.Namespace) -> None:
    skill = None if arguments.none else named_or_file(arguments.file)
    with client.client_of(arguments) as cell:
        before = skill_transfer.running(cell)
        if skill is not None and before is not None:
            skill = for_task(skill, before.definition)
        given_up = _agreed(before, skill, arguments)
        if skill is None:
            skill_transfer.forget(cell)
        else:
            skill_transfer.give(cell, skill)
        if before is None:
            what = "nothing learnt" if skill is None else f"skill {skill.sha256[:12]}"
            print(f"no task is running in cell {cell.keys.cell}: the next one will begin with {what}")
            return
        now = skill_transfer.taken(cell, None if skill is None else skill.sha256, arguments.timeout)
    print(skill_transfer.beginning(now))
    if given_up is not None:
        print(f"run {given_up} stays in the store: treenail checkpoint export FILE --run {given_up}")


def _agreed(running: Experiment | None, skill: NamedSkill | None, arguments: argparse.Namespace) -> str | None:
    """Return the run under way that a skill would end before its end, once somebody has agreed; None for none.

    Raises CellError when nobody has.
    """
    chosen = None if skill is None else skill.sha256
    if running is None or running.phase == "finished" or running.skill_sha256 == chosen:
        return None
    where = f"run {running.run} is under way, {running.episodes_done} of {running.episodes} episodes done"
    if not arguments.yes:
        if not sys.stdin.isatty():
            raise CellError(f"{where}: expected --yes to give it up, got nothing; it would stay in the store")
        if input(f"{where}; give it up (it stays in the store)? [y/N] ").strip().lower() not in ("y", "yes"):
            raise CellError(f"{where}: it goes on, nothing was changed")
    return running.run


def _list(arguments: argparse.Namespace) -> None:
    runs: list[Row] = []
    left_out: dict[str, str] = {}
    with _store(arguments) as store:
        for run in stored.runs(store):
            try:
                runs += _rows(run)
            except (ContractError, OtherContractError) as error:
                left_out[run.name] = str(error)
        skills = stored.skills(store)
    skill_rows: list[Row] = [
        {**_named(skill), "bytes": size, "chosen": name == skills.chosen}
        for name, (skill, size) in skills.found.items()
    ]
    if arguments.json:
        print(json.dumps({"runs": runs, "skills": skill_rows, "left_out": left_out}))
        return
    shown = console()
    shown.print(_table(f"{store.where}: what was learnt", _HEADINGS, runs))
    if skill_rows:
        shown.print(_table("Skills to begin with", _SKILL_HEADINGS, skill_rows))
    for why in left_out.values():
        print(f"left out: {why}")


def _show(arguments: argparse.Namespace) -> None:
    row = _described(_wanted(arguments))
    if arguments.json:
        print(json.dumps(row))
        return
    made = Table(show_header=False)
    made.add_column(style="cyan", no_wrap=True)
    made.add_column(overflow="fold")
    for name, value in row.items():
        made.add_row(name, "nothing learnt" if value is None else str(value))
    console().print(made)


def _wanted(arguments: argparse.Namespace) -> NamedSkill:
    """Return what ``show`` is asked for: a file needs no cell."""
    what = arguments.what
    if what is not None and (what == BUILTIN or Path(what).exists() or not _IN_STORE.fullmatch(what)):
        return named_or_file(what)
    with _store(arguments) as store:
        known = [] if what is None else [run.name for run in stored.runs(store)]
        if what is None or what in known:
            return learnt(stored.run_named(store, what))
        skills = [found for found, _ in stored.skills(store).found.values()]
    fitting = [skill for skill in skills if skill.sha256.startswith(what)]
    if len(fitting) == 1:
        return fitting[0]
    there = ", ".join([*known, *(skill.sha256[:12] for skill in skills)]) or "none"
    raise CellError(f"checkpoint: expected a file, or a run or skill that the store knows ({there}), got {what}")


def _rows(run: StoredRun) -> list[Row]:
    """Return a row for the journal of a run, and one for each of its checkpoints. Raises as ``StoredRun`` does."""
    run.record()
    newest = run.newest()
    episodes, decisions = (0, 0) if newest is None else (newest.episode + 1, newest.first_decision + len(newest.steps))
    journal: Row = {"service": "task", "episodes": episodes, "decisions": decisions, "bytes": run.newest_bytes()}
    rows: dict[object, Row] = {None: {"run": run.name, **journal, "newest": True}}
    for name, found, size in run.checkpoints():  # the newest comes twice, and last under the name that says so
        place: Row = {"episodes": found.episode, "decisions": found.decisions, "bytes": size}
        row: Row = {"run": run.name, "service": found.service, **place, "newest": name.endswith(f"/{LATEST}")}
        rows[found.service, found.episode] = row
    return list(rows.values())


def _named(skill: NamedSkill) -> Row:
    inside = skill.skill
    return {
        "skill": skill.sha256,
        "run": inside.run,
        "episodes": inside.episodes,
        "states": skill.states,
        "version": skill.version,
    }


def _described(skill: NamedSkill) -> Row:
    inside = skill.skill
    made = digests(inside)
    kinds = in_force(inside.definition, inside.swaps)
    return {
        **_named(skill),
        "experiment": inside.definition.name,
        "source": inside.definition.source,
        "definition": inside.definition_sha256,
        "classifier": kind_of(kinds.classifier),
        "learner": kind_of(kinds.learner),
        "swaps": "; ".join(words(swap) for swap in inside.swaps) or "none",
        "seed": inside.seed,
        "q_table": made["q_table"],
        "art2": made["art2"],
        "contract": inside.contract_sha256,
        "actions": ",".join(inside.actions),
        "began_with": inside.skill_sha256,
    }


def _table(title: str, headings: tuple[str, ...], rows: list[Row]) -> Table:
    made = Table(title=title)
    for heading in headings:
        made.add_column(heading, justify="right" if heading in _NUMBERS else "left")
    for row in rows:
        cells = [row[heading] for heading in headings]
        made.add_row(*("yes" if cell is True else "" if cell is False else _brief(cell) for cell in cells))
    return made


def _brief(value: str | int | None) -> str:
    """Return a cell of a table: a hash shortened, as it may be given to ``show``."""
    text = str(value)
    return text[:12] if len(text) == 64 else text
