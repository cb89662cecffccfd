"""A store's file as it is at one moment, read without touching it, even while a store has it open.

A store keeps its SQLite file locked, and its newest puts stand in the log beside the file. So file and log are copied
into a temporary folder, and the copy is opened as a store opens its own: what the log holds is folded in there. Nothing
is locked, written or created beside the original, which may be on a medium that cannot be written to.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from services.cell.stored import Value
from services.store.database import Database
from services.store.sqlite_file import StoreError, what_to_do
from services.wire.errors import CellError
from services.wire.keys import ROOT, RUN, Keys, wild

FILE = "store.sqlite"
"""Name of the store's file in the folder of a run."""
_ATTEMPTS = 50
_LOG_HEADER_BYTES = 32


class StoreFile:
    """The stored keys of all cells in a file, as they were when it was opened."""

    def __init__(self, database: Database, path: Path, copy: Path) -> None:
        """``path`` is the file's own name, ``copy`` is what is open: no error names that."""
        self._database = database
        self._copy = copy
        self.path = path

    def cells(self) -> list[str]:
        """Return the cells that have a run in the file."""
        with _one_line(self.path, self._copy):
            keys = self._database.keys(f"{ROOT}/*/{wild(RUN)}")
        return sorted({key.key.split("/")[1] for key in keys})

    def values(self, cell: str, expression: str) -> list[Value]:
        """Return all stored values of a cell whose names a key expression matches, by name. Raises CellError."""
        prefix = Keys(cell).of("")
        with _one_line(self.path, self._copy):
            found = self._database.get(prefix + expression)
        if found.damaged:
            raise CellError(f"{self.path}: damaged: {', '.join(found.damaged[:5])}; {what_to_do(self.path)}")
        return [
            Value(value.key.removeprefix(prefix), value.payload, value.encoding, int(value.timestamp[:16], 16))
            for value in found.values
        ]


class InFile:
    """One cell's part of a store's file."""

    def __init__(self, file: StoreFile, cell: str) -> None:
        self._file = file
        self._cell = cell
        self.path = file.path
        self.where = f"{file.path}, cell {cell}"

    def values(self, expression: str) -> list[Value]:
        """Return what matches; see ``services.cell.stored.Stored``."""
        return self._file.values(self._cell, expression)

    def working_on(self) -> None:
        """Nobody works in a file that is read."""


@contextmanager
def opened(path: Path) -> Iterator[StoreFile]:
    """Give the content of a store's file, or of the one in a run's folder.

    Raises CellError when it cannot be read, is damaged, or is none.
    """
    path = path / FILE if path.is_dir() else path
    if not path.is_file():
        raise CellError(f"{path}: expected a store's file, got none")
    with tempfile.TemporaryDirectory(prefix="treenail-") as folder:
        copy = Path(folder) / FILE
        try:
            _copy(path, copy)
        except OSError as error:
            raise CellError(f"{path}: cannot be read: {error.strerror}") from error
        with _one_line(path, copy):
            database = Database(copy)
        with database:
            yield StoreFile(database, path, copy)


def _copy(path: Path, copy: Path) -> None:
    """Copy file and log as they belong together at one moment. Raises OSError or CellError.

    The log is copied last: whatever a store moves from the log into the file meanwhile is in the log still, and counts
    for more than what the file has, as long as the log is not begun anew. Then its header is another one.
    """
    log = _log(path)
    for _ in range(_ATTEMPTS):
        before = _moment(path)
        shutil.copyfile(path, copy)
        _log(copy).unlink(missing_ok=True)
        with suppress(FileNotFoundError):
            shutil.copyfile(log, _log(copy))
        if _moment(path) == before:
            return
    raise CellError(f"{path}: expected a moment in which its log is not begun anew, got none in {_ATTEMPTS} attempts")


def _moment(path: Path) -> tuple[int, ...] | bytes:
    """Return what changes when the log is begun anew; without a log, when the file is written."""
    with suppress(FileNotFoundError), _log(path).open("rb") as file:
        header = file.read(_LOG_HEADER_BYTES)
        if header:
            return header
    now = path.stat()
    return now.st_ino, now.st_size, now.st_mtime_ns


def _log(path: Path) -> Path:
    return path.with_name(path.name + "-wal")


@contextmanager
def _one_line(path: Path, copy: Path) -> Iterator[None]:
    """Raise the store's errors as ours, about the original."""
    try:
        yield
    except (StoreError, OSError) as error:
        raise CellError(str(error).replace(str(copy), str(path))) from error
