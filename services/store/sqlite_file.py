"""One SQLite file of the store's own: locked against a second user, checked on opening, durable, bounded in size.

StoreError
├── StoreBusyError      another store has the file open
├── StoreFullError      no room; nothing of the batch was applied
└── StoreFileError      not a store file, one of another version, damaged, or failing
"""

from __future__ import annotations

import fcntl
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

APPLICATION_ID = 0x54524E4C
SCHEMA_VERSION = 2
PAGE_BYTES = 4096
RESERVED_PAGES = 64
SMALLEST_LIMIT_BYTES = 1 << 20

_MOST_PAGES = 1_073_741_823
_LOG_BYTES_KEPT = 8 << 20
_SCHEMA = f"""
CREATE TABLE payload (id INTEGER PRIMARY KEY, data BLOB NOT NULL);
CREATE TABLE entry (key TEXT PRIMARY KEY, timestamp TEXT NOT NULL, encoding TEXT NOT NULL, size INTEGER NOT NULL,
    sha256 BLOB NOT NULL, payload INTEGER NOT NULL) WITHOUT ROWID;
CREATE TRIGGER entry_gone AFTER DELETE ON entry BEGIN DELETE FROM payload WHERE id = OLD.payload; END;
CREATE TABLE tombstone (key TEXT PRIMARY KEY, timestamp TEXT NOT NULL) WITHOUT ROWID;
CREATE INDEX tombstone_age ON tombstone (timestamp, key);
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {SCHEMA_VERSION};
"""


def what_to_do(path: Path) -> str:
    """Return what can be done about a damaged file."""
    return f"`treenail store check {path}` says what is damaged, `treenail store salvage {path} OUT` saves the rest"


class StoreError(Exception):
    """Base of the store's errors."""


class StoreBusyError(StoreError):
    """Another store, in this process or another, has the file open."""


class StoreFullError(StoreError):
    """Disk full or size limit reached. Nothing of the batch was applied; earlier data is intact and readable."""


class StoreFileError(StoreError):
    """The file is not a store's, or of a schema version unknown here (both left untouched), or damaged, or fails."""


def _lock(path: Path) -> int:
    """Take the lock beside the file; the kernel frees it when the process ends, however it ends.

    It is a file of its own because reading the header of the database through a second descriptor would, on closing
    it, drop the locks that SQLite holds for another store in this process.
    """
    descriptor = os.open(path.with_name(path.name + ".lock"), os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(descriptor)
        raise StoreBusyError(f"{path}: expected to be its only user, got a file that another store has open") from error
    return descriptor


def _check_header(path: Path) -> None:
    """Refuse a file that is not ours before SQLite could touch it. Ours carries its marks from its first commit on."""
    header = b""
    with suppress(FileNotFoundError), path.open("rb") as file:
        header = file.read(100)
    if not header:
        return
    if len(header) < 100 or not header.startswith(b"SQLite format 3\0"):
        raise StoreFileError(f"{path}: expected a store's file, got one that is not an SQLite database")
    application, version = int.from_bytes(header[68:72]), int.from_bytes(header[60:64])
    if application != APPLICATION_ID:
        raise StoreFileError(f"{path}: expected application id {APPLICATION_ID:#x}, got {application:#x}")
    if version != SCHEMA_VERSION:
        hint = "use the version of Treenail that wrote it, or begin with another file"
        raise StoreFileError(f"{path}: expected store schema version {SCHEMA_VERSION}, got {version}; {hint}")


class SqliteFile:
    """The open file. ``connection`` is for reads inside ``translated_errors`` and for writes inside a transaction."""

    def __init__(self, path: Path, max_bytes: int | None) -> None:
        """Open or create; arguments and errors as in ``Database``."""
        if max_bytes is not None and max_bytes < SMALLEST_LIMIT_BYTES:
            raise ValueError(f"max_bytes: expected at least {SMALLEST_LIMIT_BYTES}, got {max_bytes}")
        self._path = path
        self._pages = _MOST_PAGES if max_bytes is None else max_bytes // PAGE_BYTES
        self._lock = _lock(path)
        try:
            _check_header(path)
            self.connection = sqlite3.connect(path, timeout=0, isolation_level=None, check_same_thread=False)
            try:
                with self.translated_errors():
                    self._prepare()
                    self._opened = self._identity()
            except BaseException:
                self.connection.close()
                raise
        except BaseException:
            os.close(self._lock)
            raise

    def close(self) -> None:
        """Fold the log into the file and free it. Closing twice is allowed."""
        if self._lock >= 0:
            self.connection.close()
            os.close(self._lock)
            self._lock = -1

    def size_bytes(self) -> int:
        """Return the size of the file and its log."""
        files = (self._path, self._path.with_name(self._path.name + "-wal"))
        return sum(file.stat().st_size for file in files if file.exists())

    def missing(self) -> bool:
        """Return whether the file was deleted, moved or replaced since it was opened."""
        try:
            return self._identity() != self._opened
        except OSError:
            return True

    def copy_to(self, path: Path) -> None:
        """Write what the open file holds into another one, which must not exist."""
        with self.translated_errors():
            self.connection.execute("VACUUM INTO ?", (str(path),))

    def _identity(self) -> tuple[int, int]:
        now = self._path.stat()
        return now.st_dev, now.st_ino

    @contextmanager
    def transaction(self, *, growing: bool) -> Iterator[None]:
        """Commit durably what is done inside, or none of it. Only when not ``growing`` may it use the reserve."""
        pages = self._pages - RESERVED_PAGES if growing else self._pages
        with self.translated_errors():
            self.connection.execute(f"PRAGMA max_page_count = {pages}").fetchall()
            self.connection.execute("BEGIN IMMEDIATE")
            try:
                yield
                self.connection.execute("COMMIT")
            except BaseException:
                if self.connection.in_transaction:
                    self.connection.execute("ROLLBACK")
                raise

    @contextmanager
    def translated_errors(self) -> Iterator[None]:
        """Raise SQLite's errors as the store's."""
        try:
            yield
        except sqlite3.DatabaseError as error:
            code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR)
            # A quota or a limit on file size shows as a failed write, only a full disk as SQLITE_FULL.
            if code in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_WRITE):
                raise StoreFullError(f"{self._path}: expected room for the batch, got {error}") from error
            if code == sqlite3.SQLITE_BUSY:
                raise StoreBusyError(f"{self._path}: expected to be its only user, got {error}") from error
            raise StoreFileError(
                f"{self._path}: expected a sound file, got {error}; {what_to_do(self._path)}"
            ) from error

    def _prepare(self) -> None:
        # Exclusive before the first read: then the log needs no shared memory, and other programs are kept out.
        # Secure delete, on in some builds of SQLite, would write every removed payload once more.
        for pragma in (
            "locking_mode = EXCLUSIVE",
            f"page_size = {PAGE_BYTES}",
            "synchronous = FULL",
            "secure_delete = OFF",
            f"journal_size_limit = {_LOG_BYTES_KEPT}",
        ):
            self.connection.execute(f"PRAGMA {pragma}").fetchall()
        if self.connection.execute("PRAGMA user_version").fetchone() == (0,):
            # Only here: in a file that exists, this would be a write before the check for damage.
            self.connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
            with self.transaction(growing=False):
                for statement in _SCHEMA.split(";\n"):
                    self.connection.execute(statement)
        else:
            verdict = self.connection.execute("PRAGMA quick_check(1)").fetchone()[0]
            if verdict != "ok":
                got = " ".join(verdict.split())
                raise StoreFileError(f"{self._path}: expected an undamaged file, got {got}; {what_to_do(self._path)}")
        mode = self.connection.execute("PRAGMA journal_mode = WAL").fetchone()[0]
        if mode != "wal":
            raise StoreFileError(f"{self._path}: expected a file system that can hold a log, got journal mode {mode}")
