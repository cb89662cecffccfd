"""A store's file read although it is damaged: what of it is sound, and a new file with that.

The file is never written to. A run goes into the new one as far as it can be gone on with: up to the first episode that
is missing, with the checkpoints before that. In a simulated cell the episodes after it come out the same once more.
"""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import NamedTuple

from services.store.damage import key_of
from services.store.database import Database, fits
from services.store.values import Put, StoredValue
from services.wire.codec import decode
from services.wire.errors import CellError, ContractError
from services.wire.keys import (
    CHOSEN_SKILL,
    ENTRY,
    JOURNAL_BLOCK,
    RUN,
    SKILL,
    SWAPS,
    WORKERS,
    Keys,
)
from services.wire.messages import JournalEpisode
from services.wire.text import spans

_BEYOND = 2 * JOURNAL_BLOCK
"""Episodes that are looked for beyond the last one whose key can be read."""


class Salvaged(NamedTuple):
    """What can be read of a damaged file."""

    sound: dict[str, StoredValue]
    """By key."""
    damaged: list[str]
    """Keys of values that are not what was put, or cannot be read."""
    complaint: str | None
    """What SQLite says about the file itself; None when it has nothing to say."""


class RunLeft(NamedTuple):
    """What of a run is left."""

    name: str
    values: list[StoredValue]
    """What makes a run that can be gone on with; none when it cannot."""
    episodes: int
    """How many of its episodes these are."""
    said: str


def look(path: Path, folder: Path) -> Salvaged:
    """Read all that can be read of a store's file; ``folder`` is an empty one for a copy. Raises CellError."""
    if not path.is_file():
        raise CellError(f"{path}: expected a store's file, got none")
    copy = folder / "store.sqlite"
    try:
        shutil.copyfile(path, copy)
        with suppress(FileNotFoundError):
            shutil.copyfile(path.with_name(path.name + "-wal"), copy.with_name(copy.name + "-wal"))
    except OSError as error:
        raise CellError(f"{path}: cannot be read: {error.strerror}") from error
    with closing(sqlite3.connect(copy)) as connection:
        complaint = _complaint(connection)
        keys = _keys(connection)
        sound, damaged = {}, []
        for key in sorted(keys | _possible_keys(keys)):
            value = _value(connection, key)
            if value is not None:
                sound[key] = value
            elif key in keys or _may_be_there(connection, key):
                damaged.append(key)
    if not sound and complaint is not None:
        raise CellError(f"{path}: expected a store's file of which something can be read, got none: {complaint}")
    return Salvaged(sound, damaged, complaint)


def write(salvaged: Salvaged, path: Path) -> list[RunLeft]:
    """Write what is sound and can be gone on with into a new file. Raises CellError when there is one."""
    if path.exists():
        raise CellError(f"{path}: expected no such file yet")
    left = runs(salvaged)
    skills = [value for key, value in salvaged.sound.items() if _pattern(key) in (SKILL, CHOSEN_SKILL)]
    values = [*skills, *(value for run in left for value in run.values)]
    with Database(path) as database:
        database.apply([Put(value.key, value.payload, value.encoding, value.timestamp) for value in values])
    return left


def runs(salvaged: Salvaged) -> list[RunLeft]:
    """Return what is left of each run."""
    names = dict.fromkeys(_run(key) for key in (*salvaged.sound, *salvaged.damaged) if _run(key) is not None)
    return [_run_left(salvaged, *run) for run in names if run is not None]


def _run_left(salvaged: Salvaged, cell: str, run: str) -> RunLeft:
    """Return what is left of one run."""
    keys, name = Keys(cell), f"{run} of cell {cell}"
    mine = {key: value for key, value in salvaged.sound.items() if _run(key) == (cell, run)}
    if keys.run_record(run) not in mine:
        return RunLeft(name, [], 0, f"run {name}: its record is lost, nothing can be gone on with")
    numbers = sorted(_episode(key) for key in mine if _pattern(key) == ENTRY)
    lost = [_episode(key) for key in salvaged.damaged if _run(key) == (cell, run) and _pattern(key) == ENTRY]
    first = min([*numbers, *lost], default=0)
    end = first
    while end in numbers and not (keys.swaps(run) in salvaged.damaged and _has_swaps(mine[keys.journal(run, end)])):
        end += 1
    kept = [value for key, value in mine.items() if _pattern(key) in (RUN, SWAPS)]
    kept += [mine[keys.journal(run, episode)] for episode in numbers if episode < end]
    if end > first:
        kept.append(mine[keys.journal(run, end - 1)]._replace(key=keys.journal_latest(run)))
    starts = []
    for service in WORKERS:
        of_service = [keys.checkpoint(run, service, episode) for episode in range(end + 1)]
        there = [mine[key] for key in of_service if key in mine]
        kept += there
        if there:
            kept.append(there[-1]._replace(key=keys.checkpoint_latest(run, service)))
        starts.append(_episode(there[-1].key) if there else 0)
    if first > min(starts):
        return RunLeft(name, [], 0, f"run {name}: episodes 0 to {first - 1} are not there, nor checkpoints after them")
    said = f"run {name}: goes on from episode {end}"
    if beyond := [number for number in numbers if number >= end]:
        said += f" (episodes {spans(beyond)} are sound too, but there is no way to them)"
    return RunLeft(name, kept, end - first, said)


def _complaint(connection: sqlite3.Connection) -> str | None:
    try:
        rows = [row[0] for row in connection.execute("PRAGMA integrity_check(3)")]
    except sqlite3.DatabaseError as error:
        return str(error)
    return None if rows == ["ok"] else " ".join("; ".join(rows).split())


def _keys(connection: sqlite3.Connection) -> set[str]:
    """Return the keys that can be listed, from both ends up to what is damaged."""
    keys: set[str] = set()
    for order in ("ASC", "DESC"):
        with suppress(sqlite3.DatabaseError, UnicodeDecodeError):
            for (key,) in connection.execute(f"SELECT key FROM entry ORDER BY key {order}"):
                keys.add(str(key))
    return keys


def _possible_keys(keys: set[str]) -> set[str]:
    """Return the keys that runs of which some can be listed may have beside those."""
    possible: set[str] = set()
    for cell, run in {place for key in keys if (place := _run(key)) is not None}:
        names = Keys(cell)
        last = max((_episode(key) for key in keys if _run(key) == (cell, run)), default=0)
        possible |= {names.run_record(run), names.swaps(run), names.journal_latest(run)}
        possible |= {names.checkpoint_latest(run, service) for service in WORKERS}
        for episode in range(last + _BEYOND):
            possible.add(names.journal(run, episode))
            possible |= {names.checkpoint(run, service, episode) for service in WORKERS}
    return possible


def _value(connection: sqlite3.Connection, key: str) -> StoredValue | None:
    """Return a sound value, None for one that is not there, cannot be read, or is not what was put."""
    query = "SELECT key, data, encoding, timestamp, sha256 FROM entry CROSS JOIN payload ON id = payload WHERE key = ?"
    with suppress(sqlite3.DatabaseError, UnicodeDecodeError, TypeError):
        row = connection.execute(query, (key,)).fetchone()
        if row is not None and fits(StoredValue(*row[:4]), row[4]):
            return StoredValue(*row[:4])
    return None


def _may_be_there(connection: sqlite3.Connection, key: str) -> bool:
    """Return whether a key is there, or cannot even be looked for."""
    try:
        return connection.execute("SELECT 1 FROM entry WHERE key = ?", (key,)).fetchone() is not None
    except sqlite3.DatabaseError:
        return False


def _has_swaps(value: StoredValue) -> bool:
    """Return whether an episode has swaps in force, without which it cannot be replayed."""
    try:
        return decode(JournalEpisode, value.payload, value.encoding).swaps > 0
    except ContractError:
        return True


def _pattern(key: str) -> str | None:
    what = key_of(key)
    return None if what is None else what.pattern


def _run(key: str) -> tuple[str, str] | None:
    """Return cell and run of a key; None for one that is not of a run."""
    what = key_of(key)
    return (key.split("/")[1], what.parts["run"]) if what is not None and "run" in what.parts else None


def _episode(key: str) -> int:
    """Return the episode in a key; 0 without one."""
    what = key_of(key)
    return (what.episode or 0) if what is not None else 0


def report(salvaged: Salvaged, path: Path) -> Iterator[str]:
    """Give what ``treenail store check`` says, line by line."""
    if salvaged.complaint is not None:
        yield f"{path}: damaged: {salvaged.complaint}"
    for key in salvaged.damaged:
        yield f"{path}: damaged: {key}"
    for run in runs(salvaged):
        yield run.said
    yield f"{len(salvaged.sound)} values are sound, {len(salvaged.damaged)} are damaged"
