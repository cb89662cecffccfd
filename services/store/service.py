"""The store on the bus: what is put under ``checkpoint/**`` and ``journal/**`` is kept and given back.

To a client it behaves like one of zenohd's storages: the latest value of each key, no acknowledgement but reading
back, wildcards in gets. What arrives together is written together, durably, before any query is answered.

Unlike there it does not believe everybody: a run's entries count from the holder of the role that the contract names,
skills from anybody; nothing but skills can be deleted (docs/decisions/0021-whom-the-store-believes.md).
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import zenoh

from services.bus.answers import parameters_of, wants_json
from services.bus.service import Options, Service
from services.store.contents import check, key_of_stored
from services.store.damage import mending, words
from services.store.database import Database
from services.store.retention import RetentionSettings, removable
from services.store.sqlite_file import StoreError, StoreFileError, StoreFullError, what_to_do
from services.store.values import Delete, Put, StoredValue, timestamp_text, zenoh_timestamp
from services.wire.codec import decode_any, encode, encode_json, encoding_of
from services.wire.errors import BadPayloadError, CellError, StrangerError, TreenailError
from services.wire.keys import CONTRACT, OPERATOR, STORED, Access
from services.wire.messages import Complete, Refusal
from services.wire.text import one_line

PRUNE_EVERY = 2000
"""Puts between looking for what may be forgotten."""
BATCH = 200
AHEAD_S = 3600.0
"""How far ahead of all clocks of the cell the date of a skill may be."""
MAX_BYTES = 4 << 30
"""Largest size of the file, unless it is told otherwise."""
CANNOT_WRITE = "cannot write"
GONE = (
    "expected the file that was opened here, but it was deleted, moved or replaced; nothing is written any more. "
    "What it held has been saved beside it with .rescued at its end: stop the cell, rename that, and start again"
)


class StoreFailedError(TreenailError):
    """What was put could not be written, or what is stored not be read; other data is intact."""


def serve(options: Options, path: Path, retention: RetentionSettings, max_bytes: int | None) -> None:
    """Keep the file at ``path`` until stopped. Raises CellError when the file cannot be opened, or has lost something.

    A file that is deleted meanwhile is noticed within a second; what it held is saved beside it.
    """
    log = logging.getLogger("store")
    try:
        database = Database(path, max_bytes=max_bytes)
        with _open_only_if_sound(database):
            mend(database, database.damaged(), log.warning)
    except (StoreError, OSError, ValueError) as error:
        raise CellError(f"store: {error}") from error
    with database, Service("store", options) as service:
        shells = [StoreShell(place, database, retention) for place in service.claim_all()]
        for shell in shells:
            shell.open()
        rescued = False
        while not service.stopping:
            if not service.work(0.0 if any(shell.pending for shell in shells) else 1.0):
                for shell in shells:
                    shell.flush()
            if not rescued and database.missing():
                rescued = True
                _rescue(database, log)
        for shell in shells:
            shell.flush()


def mend(database: Database, damaged: list[str], say: Callable[[str], None]) -> None:
    """Do without what is damaged, where that changes nothing.

    Raises StoreFileError when something is lost that a run stands on.
    """
    if not damaged:
        return
    keys = [stored.key for stored in database.keys("**")]
    plan = mending(keys, damaged)
    if plan.lost:
        raise StoreFileError(f"{database.path}: damaged: {words(keys, plan.lost)}; {what_to_do(database.path)}")
    database.prune(plan.drop)
    for source, target in plan.copies:
        database.copy(source, target)
    for key in damaged:
        instead = dict((target, source) for source, target in plan.copies).get(key, "what comes before it")
        say(f"{database.path}: damaged: {key}; {instead} is used in its place")


@contextmanager
def _open_only_if_sound(database: Database) -> Iterator[None]:
    try:
        yield
    except BaseException:
        database.close()
        raise


def _rescue(database: Database, log: logging.Logger) -> None:
    path = database.path.with_name(database.path.name + ".rescued")
    try:
        database.rescue(path)
        log.error("%s: deleted, moved or replaced while in use; what it held is in %s", database.path, path)
    except (StoreError, OSError) as error:
        log.error("%s: deleted, moved or replaced while in use, and cannot be saved: %s", database.path, error)


class StoreShell:
    """One cell's part of the store: collects operations into batches and answers queries from the database."""

    def __init__(self, service: Service, database: Database, retention: RetentionSettings) -> None:
        self._service = service
        self._database = database
        self._retention = retention
        self._prefix = service.keys.of("")
        self._until_prune = 0
        self._newest = ""
        """Timestamp of the newest operation of a role's holder."""
        self.pending: list[Put | Delete] = []

    def open(self) -> None:
        """Begin to serve the cell."""
        for name in STORED:
            self._service.subscribe_raw(name, self.on_sample)
            self._service.answer_raw(name, self.on_query)
        self._service.ready()
        self.flush()

    def on_sample(self, sample: zenoh.Sample) -> None:
        """Take a put or delete into the next batch. Raises ContractError or StrangerError for what is not taken."""
        self._service.handled += 1
        try:
            operation = self._operation(sample)
        except ValueError as error:
            raise BadPayloadError(f"{sample.key_expr}: {error}") from error
        if operation is None:
            return
        self.pending.append(operation)
        if len(self.pending) >= BATCH:
            self.flush()

    def _operation(self, sample: zenoh.Sample) -> Put | Delete | None:
        """Return what is to be done; None for a value that is here already, put again as it is."""
        key, deleted = str(sample.key_expr), sample.kind == zenoh.SampleKind.DELETE
        timestamp = timestamp_text(sample.timestamp or self._service.session.new_timestamp())
        name = key.removeprefix(self._prefix)
        if deleted:
            operation: Put | Delete = Delete(key, timestamp)
            what = key_of_stored(name)
        else:
            payload, encoding = sample.payload.to_bytes(), str(sample.encoding)
            operation = Put(key, payload, encoding, timestamp)
            what = check(name, payload, encoding)
        access = Access() if what is None else CONTRACT[what.pattern].access
        allowed = access.delete if deleted else access.put
        if not allowed:
            raise StrangerError(f"{key}: expected a put, as nobody may delete this, got a delete")
        if OPERATOR in allowed:
            self._check_date(key, timestamp)
            return operation
        assert what is not None
        roles = (what.parts["service"],) if "service" in what.parts else allowed
        try:
            self._service.check_holder(sample, roles)
        except StrangerError:
            if any(stored.key == key and stored.timestamp == timestamp for stored in self._database.keys(key)):
                return None  # whoever has read a value from the future puts it again, so that his clock follows it
            raise
        self._newest = max(self._newest, timestamp)
        return operation

    def _check_date(self, key: str, timestamp: str) -> None:
        """Raise BadPayloadError for a date that no clock of the cell has come to: it would outlast all that follow."""
        latest = max(self._newest, f"{time.time_ns() * (1 << 32) // 10**9:016x}")
        ahead_s = (int(timestamp[:16], 16) - int(latest[:16], 16)) / (1 << 32)
        if ahead_s > AHEAD_S:
            expected = f"expected a date at most {AHEAD_S:g} s ahead of the store's clock and of what it was given"
            raise BadPayloadError(f"{key}: {expected}, got one {ahead_s:.0f} s ahead")

    def flush(self) -> None:
        """Write what has been collected; what cannot be written is given up, so that its sender, reading back, sees."""
        operations, self.pending = self.pending, []
        try:
            if self._database.missing():
                raise StoreFileError(f"{self._database.path}: {GONE}")
            if operations:
                self._write(operations)
            elif self._service.phase.startswith(CANNOT_WRITE):
                return  # until something can be written again
            self._service.phase = self._size()
        except StoreError as error:
            self._service.phase = f"{CANNOT_WRITE}: {error}"[:200]
            if operations:
                self._service.refuse(StoreFailedError(f"{len(operations)} operations not stored: {error}"))

    def _write(self, operations: list[Put | Delete]) -> None:
        try:
            self._database.apply(operations)
        except StoreFullError:
            self._prune()
            self._database.apply(operations)
        self._until_prune -= len(operations)
        if self._until_prune <= 0:
            self._prune()

    def _size(self) -> str:
        """Return the phase of a store that works: how much of its room is taken."""
        most = self._database.max_bytes
        room = "" if most is None else f" of at most {most / 1e6:.0f}"
        return f"running, {self._database.size_bytes() / 1e6:.1f}{room} MB"

    def on_query(self, query: zenoh.Query) -> None:
        """Reply with every stored value that the query's key expression matches.

        With ``?complete`` the last reply is an error reply of type Complete: so that nothing can be told from nobody,
        and all from a part.
        """
        self.flush()
        as_json = False
        try:
            parameters = parameters_of(query)
            as_json = wants_json(parameters.get("format", "msgpack"))
            if self._database.missing():
                raise StoreFileError(f"{self._database.path}: {GONE}")
            values = self._sound(str(query.key_expr))
            for value in values:
                _reply(query, value, as_json)
            if "complete" in parameters:
                query.reply_err(encode(Complete(values=len(values))), encoding=encoding_of(Complete))
        except (StoreError, TreenailError) as error:
            refusal = Refusal(reason="bad_request", message=one_line(str(error), 1000))
            if as_json:
                query.reply_err(encode_json(refusal), encoding="application/json")
            else:
                query.reply_err(encode(refusal), encoding=encoding_of(Refusal))
            self._service.refuse(error if isinstance(error, TreenailError) else StoreFailedError(f"query: {error}"))

    def _sound(self, expression: str) -> list[StoredValue]:
        """Return what is stored. Raises StoreFileError when something that nobody can replace is damaged."""
        reading = self._database.get(expression)
        if reading.damaged:
            mend(self._database, reading.damaged, self._service.log.warning)
            reading = self._database.get(expression)
        return reading.values

    def _prune(self) -> None:
        self._until_prune = PRUNE_EVERY
        keys = self._database.keys(f"{self._prefix}**")
        surplus = removable(((key.key, key.timestamp) for key in keys), self._retention)
        for start in range(0, len(surplus), 1000):
            self._database.prune(surplus[start : start + 1000])
        if surplus:
            self._service.log.info("forgot %d keys", len(surplus))


def _reply(query: zenoh.Query, value: StoredValue, as_json: bool) -> None:
    payload, encoding = value.payload, value.encoding
    if as_json:
        payload, encoding = encode_json(decode_any(payload, encoding)), "application/json"
    query.reply(value.key, payload, encoding=encoding, timestamp=zenoh_timestamp(value.timestamp))
