"""The store's memory: the latest payload, encoding and timestamp of every Zenoh key, in one SQLite file.

What a client can see follows the storages of Zenoh's own router. A key shows its newest put, provided that put is newer
than every delete of the key; wildcard deletes and wildcard puts act on the keys that are stored, and on older puts that
arrive later. Unlike there, the outcome does not depend on the order of arrival: an entry remembers the time of its
newest own put (``born``) beside the time of the value it shows.

Durability: write-ahead log with ``synchronous=FULL``. When ``apply`` has returned, its batch survives SIGKILL and power
failure. A second store on the same file is refused. Single-threaded: one caller at a time, from any thread.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from services.store.sqlite_file import SqliteFile
from services.store.values import Delete, Put, StoredKey, StoredValue, key_expression, key_range

DELETES_REMEMBERED = 10_000
WILDCARDS_REMEMBERED = 1_000

# The range is cheap and comes first; what it lets through is matched by Zenoh's own rule.
_MATCHES = "key >= :low AND key < :high AND intersects(:expression, key)"


def _intersects(expression: str, key: str) -> bool:
    return key_expression(expression).intersects(key)


def _bounds(expression: str) -> dict[str, str | bytes]:
    key_expression(expression)
    low, high = key_range(expression)
    return {"low": low, "high": high, "expression": expression}


class Database:
    """The store's file. Every method but ``close`` raises StoreFileError if the file turns out damaged or failing."""

    def __init__(self, path: Path, *, max_bytes: int | None = None) -> None:
        """Open the file, or create it; its folder must exist.

        ``max_bytes`` limits the file (at least 1 MiB; the write-ahead log, some 4 MiB and a batch, comes on top). The
        last 256 KiB of it are kept for deletes, so that a full store can be emptied. The whole file is checked for
        damage. Raises StoreBusyError, StoreFullError, StoreFileError, OSError, and ValueError for ``max_bytes``.
        """
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

    def apply(self, operations: Sequence[Put | Delete]) -> int:
        """Carry out the operations as one durable transaction: all or none.

        Returns how many took effect: puts that became the newest of their key and are not deleted, deletes and
        wildcard puts that changed at least one stored key. Raises StoreFullError; deletes alone may still go through
        then, and so does ``prune``.
        """
        puts = any(isinstance(operation, Put) for operation in operations)
        deletes = any(isinstance(operation, Delete) or "*" in operation.key for operation in operations)
        with self._file.transaction(growing=puts):
            effective = sum([self._apply(operation) for operation in operations])
            if deletes:
                self._forget_old_deletes()
        return effective

    def get(self, key_expression: str) -> list[StoredValue]:
        """Every stored value whose key intersects, sorted by key. ValueError if it is not a key expression.

        All payloads are held in memory at once; ``keys`` tells their sizes beforehand.
        """
        query = f"""SELECT key, data, encoding, timestamp FROM entry CROSS JOIN payload ON id = payload
            WHERE {_MATCHES} ORDER BY key"""
        with self._file.translated_errors():
            return [StoredValue(*row) for row in self._connection.execute(query, _bounds(key_expression))]

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
        """Return ``entries``, ``payload_bytes``, ``file_bytes`` (with the log) and ``deletes_remembered``.

        The last one counts tombstones and wildcard operations.
        """
        query = """SELECT COUNT(*), IFNULL(SUM(size), 0),
            (SELECT COUNT(*) FROM tombstone) + (SELECT COUNT(*) FROM wildcard) FROM entry"""
        with self._file.translated_errors():
            entries, payload_bytes, deletes = self._connection.execute(query).fetchone()
        return {
            "entries": entries,
            "payload_bytes": payload_bytes,
            "file_bytes": self._file.size_bytes(),
            "deletes_remembered": deletes,
        }

    def _execute(self, statement: str, *values: str | int | bytes) -> int:
        return self._connection.execute(statement, values).rowcount

    def _apply(self, operation: Put | Delete) -> bool:
        if isinstance(operation, Put):
            return self._put_matching(operation) if "*" in operation.key else self._put(operation)
        return self._delete(operation)

    def _put(self, put: Put) -> bool:
        query = """SELECT 1 FROM tombstone WHERE key = :key AND timestamp >= :time
            UNION ALL SELECT 1 FROM entry WHERE key = :key AND born >= :time
            UNION ALL SELECT 1 FROM wildcard WHERE timestamp >= :time AND NOT is_put AND intersects(expression, :key)"""
        names = {"key": put.key, "time": put.timestamp}
        if self._connection.execute(query, names).fetchone():
            return False
        query = """SELECT data, encoding, timestamp FROM wildcard
            WHERE timestamp > :time AND is_put AND intersects(expression, :key) ORDER BY timestamp DESC LIMIT 1"""
        newer = self._connection.execute(query, names).fetchone()
        data, encoding, timestamp = newer or (put.payload, put.encoding, put.timestamp)
        row = (put.key, timestamp, put.timestamp, encoding, len(data))
        stored = self._connection.execute("SELECT payload FROM entry WHERE key = ?", (put.key,)).fetchone()
        if stored:
            self._execute("UPDATE payload SET data = ? WHERE id = ?", data, stored[0])
            self._execute("UPDATE entry SET timestamp = ?2, born = ?3, encoding = ?4, size = ?5 WHERE key = ?1", *row)
        else:
            payload = self._connection.execute("INSERT INTO payload (data) VALUES (?)", (data,)).lastrowid
            self._connection.execute("INSERT INTO entry VALUES (?, ?, ?, ?, ?, ?)", (*row, payload))
        return True

    def _put_matching(self, put: Put) -> bool:
        self._remember(put, put.encoding, put.payload)
        older = f"{_MATCHES} AND timestamp < :time"
        values = _bounds(put.key) | {"time": put.timestamp, "data": put.payload, "encoding": put.encoding}
        matching = f"UPDATE payload SET data = :data WHERE id IN (SELECT payload FROM entry WHERE {older})"
        self._connection.execute(matching, values)
        update = "UPDATE entry SET timestamp = :time, encoding = :encoding, size = length(:data)"
        return self._connection.execute(f"{update} WHERE {older}", values).rowcount > 0

    def _delete(self, delete: Delete) -> bool:
        # The entry goes first: it may make the room that the memory of its delete needs.
        values = _bounds(delete.key) | {"time": delete.timestamp}
        query = f"DELETE FROM entry WHERE {_MATCHES} AND born <= :time"
        removed = self._connection.execute(query, values).rowcount > 0
        if "*" in delete.key:
            self._remember(delete, None, None)
        else:
            self._execute("""INSERT INTO tombstone VALUES (?, ?) ON CONFLICT DO
                UPDATE SET timestamp = excluded.timestamp WHERE excluded.timestamp > timestamp""",
                          delete.key, delete.timestamp)  # fmt: skip
        return removed

    def _remember(self, operation: Put | Delete, encoding: str | None, data: bytes | None) -> None:
        statement = """INSERT INTO wildcard VALUES (?, ?, ?, ?, ?) ON CONFLICT DO UPDATE
            SET timestamp = excluded.timestamp, encoding = excluded.encoding, data = excluded.data
            WHERE excluded.timestamp > timestamp"""
        row = (operation.key, operation.timestamp, encoding, data, data is not None)
        self._connection.execute(statement, row)

    def _forget_old_deletes(self) -> None:
        """Keep the newest only: a put that is older than so many deletes is not expected any more."""
        self._execute("""DELETE FROM tombstone WHERE (timestamp, key) <
            (SELECT timestamp, key FROM tombstone ORDER BY timestamp DESC, key DESC LIMIT 1 OFFSET ?)""",
                      DELETES_REMEMBERED - 1)  # fmt: skip
        self._execute("""DELETE FROM wildcard WHERE (timestamp, expression, is_put) <
            (SELECT timestamp, expression, is_put FROM wildcard
             ORDER BY timestamp DESC, expression DESC, is_put DESC LIMIT 1 OFFSET ?)""",
                      WILDCARDS_REMEMBERED - 1)  # fmt: skip
