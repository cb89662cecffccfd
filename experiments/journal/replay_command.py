"""``treenail replay``: rebuild a run's memory and episode log from its journal, without physics, and compare."""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import msgspec
from rich.table import Table

from experiments.journal import options as journal_options
from experiments.journal.replay import Replay
from experiments.journal.store_file import InFile
from experiments.journal.witnesses import Compared, Witnesses
from experiments.lab.result_files import SUMMARY, ResultsError
from services.cell.client import Client
from services.cell.stored import InCell, StoredRun, chosen, runs
from services.cell.terminal import console
from services.rules.command_line import Parser, whole
from services.rules.results import RunSummary, Summary
from services.rules.skill import NamedSkill
from services.rules.swaps import words
from services.wire.definition_file import run_id_of
from services.wire.errors import NoAnswerError, RefusedError
from services.wire.keys import CLASSIFIER_STATES, Q_TABLE
from services.wire.messages import ClassifierStates, QTable, RunRecord, Swap

PROGRAM = "treenail replay"
JOURNALLED_WITHIN_S = 10.0
"""How long a living cell gets to journal the episode that its workers are in."""
LOOK_EVERY_S = 0.1


def main(words: Sequence[str] | None = None) -> int:
    """Do what the command line (or ``words`` in its place) says and return the exit status."""
    return journal_options.status(PROGRAM, lambda: _act(_parser().parse_args(words)))


def _act(arguments: argparse.Namespace) -> bool:
    """Replay, print, and return whether everything agrees."""
    until = arguments.until
    with journal_options.places(arguments, arguments.store) as places:
        run = chosen(places, arguments.run)
        record = run.record()
        began_with = run.skill(record.skill_sha256)
        table, states = _living_in(run, until)
        checkpoints, newest = run.checkpoints(), run.newest()
        total = run.length() if until is None else until
        swaps = run.swaps()  # after the length: the store has the swaps of an episode before that begins
        witnesses = Witnesses(checkpoints, _summary_of(run, record, swaps, arguments), table, states, newest)
        replay = witnesses.replay(record, began_with, swaps)
        for entry in journal_options.shown(run.episodes(total), "replay", total):
            replay.fold(entry)
    compared = witnesses.compared(replay, began_with, until)
    alone = witnesses.alone(replay, compared)
    if arguments.json:
        print(json.dumps({**_as_json(replay, began_with, compared), "bounded_episodes": alone}))
    else:
        _print(replay, began_with, compared, with_states=until is not None)
        of = f"{alone} of {replay.episodes} episodes"
        agree = f"equal; means and peaks of {of}, which nothing else tells, are within their bounds"
        print((agree if alone else "equal") if _agrees(replay, compared) else "DIFFERS")
    return _agrees(replay, compared)


def _agrees(replay: Replay, compared: Sequence[Compared]) -> bool:
    return not replay.mismatches and all(one.equal is not False for one in compared)


def _living_in(run: StoredRun, until: int | None) -> tuple[QTable | None, ClassifierStates | None]:
    """Return the memories of a living cell's workers, once the journal goes as far as they."""
    if not isinstance(run.stored, InCell) or until is not None:
        return None, None
    table, states = _living(run.stored.client, run.name)
    _wait_until_journalled(run, table, states)
    return table, states


def _summary_of(
    run: StoredRun, record: RunRecord, swaps: Sequence[Swap], arguments: argparse.Namespace
) -> RunSummary | None:
    path = arguments.summary or _summary_beside(run, record, swaps)
    return None if path is None else read_summary(path, record, swaps)


def _living(client: Client, run: str) -> tuple[QTable | None, ClassifierStates | None]:
    """Return the memories of the cell's workers, if there are any and they work on that run."""
    table, states = None, None
    with suppress(NoAnswerError, RefusedError):
        table = client.ask(Q_TABLE, QTable)
    with suppress(NoAnswerError, RefusedError):
        states = client.ask(CLASSIFIER_STATES, ClassifierStates)
    return (
        table if table is not None and table.run == run else None,
        states if states is not None and states.run == run else None,
    )


def _wait_until_journalled(run: StoredRun, table: QTable | None, states: ClassifierStates | None) -> None:
    """Wait until the journal has all decisions that the workers know of; in vain if the task stands still."""
    wanted = max(0 if table is None else table.decisions, 0 if states is None else states.decisions)
    deadline = time.monotonic() + JOURNALLED_WITHIN_S
    while wanted and time.monotonic() < deadline:
        newest = run.newest()
        if newest is not None and newest.first_decision + len(newest.steps) >= wanted:
            return
        time.sleep(LOOK_EVERY_S)


def _summary_beside(run: StoredRun, record: RunRecord, swaps: Sequence[Swap]) -> Path | None:
    """Return the ``summary.json`` in the folder of a store's file if it can only be that of the run."""
    if not isinstance(run.stored, InFile):
        return None
    path = run.stored.path.with_name(SUMMARY)
    name = run_id_of(record.definition_sha256, record.seed)
    same = [other for other in runs(run.stored) if other.name == name or other.name.startswith(f"{name}-k")]
    if len(same) > 1 or not path.is_file():
        return None
    try:
        read_summary(path, record, swaps)
    except ResultsError as error:
        print(f"not compared: {error}", file=sys.stderr)
        return None
    return path


def read_summary(path: Path, record: RunRecord, swaps: Sequence[Swap] = ()) -> RunSummary:
    """Return what a ``summary.json`` says of a run. Raises ResultsError when it cannot be read or has it not."""
    try:
        found = msgspec.json.decode(path.read_bytes(), type=Summary)
    except OSError as error:
        raise ResultsError(f"{path}: cannot be read: {error.strerror}") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise ResultsError(f"{path}: expected a summary of results: {error}") from error
    of_seed = [run for run in found["runs"] if run["seed"] == record.seed]
    if found["definition_sha256"] != record.definition_sha256 or len(of_seed) != 1:
        seeds = ", ".join(str(run["seed"]) for run in found["runs"])
        expected = f"definition {record.definition_sha256[:12]} with seed {record.seed}"
        raise ResultsError(f"{path}: expected {expected}, got {found['definition_sha256'][:12]} with seed {seeds}")
    made = [words(swap) for swap in swaps if swap.episode < of_seed[0]["episodes"]]
    if found.get("swaps", []) != made:
        got = "; ".join(found.get("swaps", [])) or "none"
        raise ResultsError(f"{path}: expected the swaps {'; '.join(made) or 'none'}, got {got}")
    return of_seed[0]


def _as_json(replay: Replay, began_with: NamedSkill | None, compared: Sequence[Compared]) -> dict[str, object]:
    record, first = replay.record, replay.first_mismatch
    return {
        "run": record.run,
        "experiment": record.definition.name,
        "definition": record.definition_sha256,
        "seed": record.seed,
        "began_with": None if began_with is None else began_with.sha256,
        "swaps": [msgspec.to_builtins(swap) for swap in replay.swaps],
        "episodes": replay.episodes,
        "decisions": replay.decisions,
        "digests": replay.digests(),
        "mismatches": dict(replay.mismatches),
        "first_mismatch": None if first is None else first._asdict(),
        "compared": [one._asdict() for one in compared],
        "equal": _agrees(replay, compared),
        "states": [state._asdict() for state in replay.states()],
    }


def _print(replay: Replay, began_with: NamedSkill | None, compared: Sequence[Compared], *, with_states: bool) -> None:
    record, states = replay.record, replay.states()
    began = "nothing learnt" if began_with is None else f"skill {began_with.sha256[:12]}"
    print(f"run {record.run}: {record.definition.name}, seed {record.seed}, began with {began}")
    for swap in replay.swaps:
        print(f"swap: {words(swap)}")
    print(f"{replay.episodes} episodes, {replay.decisions} decisions, {len(states)} contact states")
    for part, digest in replay.digests().items():
        print(f"{part:<8}  {digest}")
    shown = console()
    if with_states:
        shown.print(_states_table(replay))
    if compared:
        shown.print(_compared_table(compared))
    if replay.first_mismatch is None:
        print("each step of the journal follows from those before it")
    else:
        counts = ", ".join(f"{count} {field}" for field, count in replay.mismatches.items())
        print(f"first mismatch: {replay.first_mismatch}\nmismatches in all: {counts}")


def _states_table(replay: Replay) -> Table:
    """Return the policy as it was: a row a contact state."""
    made = Table(title=f"Memory before episode {replay.episodes}", title_justify="left")
    for heading in ("state", "best", "value", "visits", "felt"):
        made.add_column(heading, justify="right")
    for row in replay.states():
        made.add_row(str(row.state), row.best_action, f"{row.value:.2f}", str(row.visits), str(row.felt))
    return made


def _compared_table(compared: Sequence[Compared]) -> Table:
    made = Table(title="Compared with the memory that is rebuilt from the journal", title_justify="left")
    for heading in ("what", "part", "when", "rebuilt", "found", ""):
        made.add_column(heading, overflow="fold")
    for one, cells in _rows(compared):
        made.add_row(*cells, style="bold red" if one.equal is False else None)
    return made


def _rows(compared: Sequence[Compared]) -> Iterator[tuple[Compared, tuple[str, ...]]]:
    """Give the cells of each row, with one of what stands in it: equal checkpoints of a worker share a row."""
    for _, group in itertools.groupby(compared, lambda one: (one.witness.rpartition("/")[0], one.part, one.equal)):
        same = list(group)
        first, last = same[0], same[-1]
        if first.equal and len(same) > 1 and "/" in first.witness:
            when = first.place if last.place == first.place else f"{first.place} to {last.place.rpartition(' ')[2]}"
            yield first, (f"{first.witness.rpartition('/')[0]}/*", first.part, when, "", "", f"{len(same)} equal")
            continue
        for one in same:
            verdict = {True: "equal", False: "DIFFERS", None: "not in the journal yet"}[one.equal]
            cells = (one.witness, one.part, one.place, _brief(one.rebuilt or "-"), _brief(one.found), verdict)
            yield one, cells


def _brief(text: str) -> str:
    return text[:12] if len(text) == 64 else text


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog=PROGRAM, description=__doc__)
    parser.add_argument(
        "run", nargs="?", metavar="RUN", help="a run's name or how it begins; not needed for the only one"
    )
    parser.add_argument(
        "--until", type=whole(0), metavar="EPISODE", help="stop before this episode and show the memory as it was then"
    )
    parser.add_argument(
        "--summary", type=Path, metavar="FILE", help="summary.json to compare with (default: the one beside --store)"
    )
    journal_options.add_arguments(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
