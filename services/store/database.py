"""The store's memory: the latest payload, encoding and timestamp of every Zenoh key, in one SQLite file.

What a client can see follows the storages of Zenoh's own router: a key shows its newest put, provided that it is newer
than every delete of the key, and the outcome does not depend on the order of arrival.

Durability: write-ahead log with ``synchronous=FULL``. When ``apply`` has returned, its batch survives SIGKILL and power
failure. A second store on the same file is refused. Single-threaded: one caller at a time, from any thread.

Truth: every entry carries the SHA-256 of key, encoding, timestamp and payload, worked out when it was put, and no value
is given back that does not fit it (docs/decisions/0020-digests-in-the-store.md).
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

from services.store.sqlite_file import SqliteFile
from services.store.values import Delete, Put, StoredKey, StoredValue, key_expression, key_range

DELETES_REMEMBERED = 10_000

# The range is cheap and comes first; what it lets through is matched by Zenoh's own rule.
_MATCHES = "key >= :low AND key < :high AND intersects(:expression, key)"


def _intersects(expression: str, key: str) -> bool:
    return key_expression(expression).intersects(key)


def _bounds(expression: str) -> dict[str, str | bytes]:
    key_expression(expression)
    low, high = key_range(expression)
    return {"low": low, "high": high, "expression": expression}


def fits(value: StoredValue, sha256: bytes) -> bool:
    """Return whether a value is what was put when its digest was worked out."""
    return _digest(value.key, value.encoding, value.timestamp, value.payload) == sha256


def _digest(key: str, encoding: str, timestamp: str, payload: bytes) -> bytes:
    # No part can run into the next one: Zenoh's keys and timestamps have no zero byte.
    return hashlib.sha256(b"\0".join((f"{key}\0{timestamp}\0{len(payload)}\0{encoding}".encode(), payload))).digest()


class Reading(NamedTuple):
    """What is stored under some keys."""

    values: list[StoredValue]
    """Sorted by key."""
    damaged: list[str]
    """Keys of values that are not what was put; they are not among ``values``."""


class Database:
    """The store's file. Every method but ``close`` raises StoreFileError if the file turns out damaged or failing."""

    def __init__(self, path: Path, *, max_bytes: int | None = None) -> None:
        """Open the file, or create it; its folder must exist.

        ``max_bytes`` limits the file (at least 1 MiB; the write-ahead log, some 4 MiB and a batch, comes on top). The
        last 256 KiB of it are kept for deletes, so that a full store can be emptied. The whole file is checked for
        damage. Raises StoreBusyError, StoreFullError, StoreFileError, OSError, and ValueError for ``max_bytes``.
        """
        self.path = path
        self.max_bytes = max_bytes
        self._file = SqliteFile(path, max_bytes)
        self._connection = self._file.connection
        self._connection.create_function("intersects", 2, _intersects, deterministic=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Fold the log into the file and free it. Closing twice is allowed."""
        self._file.close()

    def missing(self) -> bool:
        """Return whether the file was deleted, moved or replaced since it was opened."""
        return self._file.missing()

    def size_bytes(self) -> int:
        """Return the size of the file and its log."""
        return self._file.size_bytes()

    def rescue(self, path: Path) -> None:
        """Write all that is stored into another file, which must not exist: a file that was deleted is still open."""
        self._file.copy_to(path)

    def apply(self, operations: Sequence[Put | Delete]) -> int:
        """Carry out the operations as one durable transaction: all or none.

        Returns how many took effect: puts that became the newest of their key and are not deleted, and deletes that
        removed something. Raises StoreFullError; deletes alone may still go through then, and so does ``prune``.
        """
        with self._file.transaction(growing=any(isinstance(operation, Put) for operation in operations)):
            effective = sum([self._apply(operation) for operation in operations])
            if any(isinstance(operation, Delete) for operation in operations):
                self._forget_old_deletes()
        return effective

    def get(self, key_expression: str) -> Reading:
        """Every stored value whose key intersects. ValueError if it is not a key expression.

        All payloads are held in memory at once; ``keys`` tells their sizes beforehand.
        """
        reading = Reading([], [])
        for value, sound in self._rows(key_expression):
            reading.values.append(value) if sound else reading.damaged.append(value.key)
        return reading

    def damaged(self) -> list[str]:
        """Return the keys of all values that are not what was put."""
        return [value.key for value, sound in self._rows("**") if not sound]

    def _rows(self, key_expression: str) -> Iterator[tuple[StoredValue, bool]]:
        query = f"""SELECT key, data, encoding, timestamp, sha256 FROM entry CROSS JOIN payload ON id = payload
            WHERE {_MATCHES} ORDER BY key"""
        with self._file.translated_errors():
            for *row, sha256 in self._connection.execute(query, _bounds(key_expression)):
                value = StoredValue(*row)
                yield value, fits(value, sha256)

    def copy(self, source: str, target: str) -> None:
        """Let a key hold what another one does, and its time. Raises StoreFileError without a sound value there."""
        reading = self.get(source)
        with self._file.transaction(growing=False):
            self._execute("DELETE FROM entry WHERE key = ?", target)
            for value in reading.values:
                self._insert(Put(target, value.payload, value.encoding, value.timestamp))

    def keys(self, key_expression: str) -> list[StoredKey]:
        """Like ``get``, without reading the payloads."""
        query = f"SELECT key, size, timestamp FROM entry WHERE {_MATCHES} ORDER BY key"
        with self._file.translated_errors():
            return [StoredKey(*row) for row in self._connection.execute(query, _bounds(key_expression))]

    def prune(self, keys: Sequence[str]) -> int:
        """Remove these keys for good, durably, and shrink the file; later puts of them are welcome, even older ones.

        Returns how many were stored. Takes time in proportion: slices of some 1000 keys keep the pauses short.
        """
        with self._file.transaction(growing=False):
            removed = sum([self._execute("DELETE FROM entry WHERE key = ?", key) for key in keys])
            # Page by page: without a number, the pragma would stop after the first page when stepped from Python.
            (free_pages,) = self._connection.execute("PRAGMA freelist_count").fetchone()
            for _ in range(free_pages):
                self._connection.execute("PRAGMA incremental_vacuum(1)")
        return removed

    def statistics(self) -> dict[str, int]:
        """Return ``entries``, ``payload_bytes``, ``file_bytes`` (with the log) and ``deletes_remembered``."""
        query = """SELECT COUNT(*), IFNULL(SUM(size), 0),
            (SELECT COUNT(*) FROM tombstone) FROM entry"""
        with self._file.translated_errors():
            entries, payload_bytes, deletes = self._connection.execute(query).fetchone()
        return {
            "entries": entries,
            "payload_bytes": payload_bytes,
            "file_bytes": self.size_bytes(),
            "deletes_remembered": deletes,
        }

    def _execute(self, statement: str, *values: str | int | bytes) -> int:
        return self._connection.execute(statement, values).rowcount

    def _apply(self, operation: Put | Delete) -> bool:
        return self._put(operation) if isinstance(operation, Put) else self._delete(operation)

    def _put(self, put: Put) -> bool:
        query = """SELECT 1 FROM tombstone WHERE key = :key AND timestamp >= :time
            UNION ALL SELECT 1 FROM entry WHERE key = :key AND timestamp >= :time"""
        if self._connection.execute(query, {"key": put.key, "time": put.timestamp}).fetchone():
            return False
        self._insert(put)
        return True

    def _insert(self, put: Put) -> None:
        data = put.payload
        row = (put.key, put.timestamp, put.encoding, len(data), _digest(put.key, put.encoding, put.timestamp, data))
        stored = self._connection.execute("SELECT payload FROM entry WHERE key = ?", (put.key,)).fetchone()
        if stored:
            self._execute("UPDATE payload SET data = ? WHERE id = ?", data, stored[0])
            self._execute("UPDATE entry SET timestamp = ?2, encoding = ?3, size = ?4, sha256 = ?5 WHERE key = ?1", *row)
        else:
            payload = self._connection.execute("INSERT INTO payload (data) VALUES (?)", (data,)).lastrowid
            self._connection.execute("INSERT INTO entry VALUES (?, ?, ?, ?, ?, ?)", (*row, payload))

    def _delete(self, delete: Delete) -> bool:
        # The entry goes first: it may make the room that the memory of its delete needs.
        removed = self._execute("DELETE FROM entry WHERE key = ? AND timestamp <= ?", delete.key, delete.timestamp) > 0
        self._execute("""INSERT INTO tombstone VALUES (?, ?) ON CONFLICT DO
            UPDATE SET timestamp = excluded.timestamp WHERE excluded.timestamp > timestamp""",
                      delete.key, delete.timestamp)  # fmt: skip
        return removed

    def _forget_old_deletes(self) -> None:
        """Keep the newest only: a put that is older than so many deletes is not expected any more."""
        self._execute("""DELETE FROM tombstone WHERE (timestamp, key) <
            (SELECT timestamp, key FROM tombstone ORDER BY timestamp DESC, key DESC LIMIT 1 OFFSET ?)""",
                      DELETES_REMEMBERED - 1)  # fmt: skip
