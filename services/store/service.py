"""The store on the bus: what is put under ``checkpoint/**`` and ``journal/**`` is kept and given back.

To a client it behaves like one of zenohd's storages: the latest value of each key, no acknowledgement but reading
back, wildcards in gets and deletes. What arrives together is written together, durably, before any query is answered.
"""

from __future__ import annotations

from pathlib import Path

import zenoh

from services.bus.answers import parameters_of, wants_json
from services.bus.service import Options, Service
from services.store.contents import check
from services.store.database import Database
from services.store.retention import RetentionSettings, removable
from services.store.sqlite_file import StoreError, StoreFullError
from services.store.values import Delete, Put, StoredValue, timestamp_text, zenoh_timestamp
from services.wire.codec import decode_any, encode, encode_json, encoding_of
from services.wire.errors import BadPayloadError, CellError, TreenailError
from services.wire.keys import STORED
from services.wire.messages import Refusal
from services.wire.text import one_line

PRUNE_EVERY = 2000
"""Puts between looking for what may be forgotten."""
BATCH = 200


class StoreFailedError(TreenailError):
    """What was put could not be written, or what is stored not be read; other data is intact."""


def serve(options: Options, path: Path, retention: RetentionSettings, max_bytes: int | None) -> None:
    """Keep the file at ``path`` until stopped. Raises CellError when the file cannot be opened."""
    try:
        database = Database(path, max_bytes=max_bytes)
    except (StoreError, OSError, ValueError) as error:
        raise CellError(f"store: {error}") from error
    with database, Service("store", options) as service:
        shells = [StoreShell(place, database, retention) for place in service.claim_all()]
        for shell in shells:
            shell.open()
        while not service.stopping:
            if not service.work(0.0 if any(shell.pending for shell in shells) else 1.0):
                for shell in shells:
                    shell.flush()
        for shell in shells:
            shell.flush()


class StoreShell:
    """One cell's part of the store: collects operations into batches and answers queries from the database."""

    def __init__(self, service: Service, database: Database, retention: RetentionSettings) -> None:
        self._service = service
        self._database = database
        self._retention = retention
        self._prefix = service.keys.of("")
        self._until_prune = 0
        self.pending: list[Put | Delete] = []

    def open(self) -> None:
        """Begin to serve the cell."""
        for name in STORED:
            self._service.subscribe_raw(name, self.on_sample)
            self._service.answer_raw(name, self.on_query)
        self._service.ready()

    def on_sample(self, sample: zenoh.Sample) -> None:
        """Take a put or delete into the next batch."""
        self._service.handled += 1
        key = str(sample.key_expr)
        timestamp = timestamp_text(sample.timestamp or self._service.session.new_timestamp())
        try:
            if sample.kind == zenoh.SampleKind.DELETE:
                self.pending.append(Delete(key, timestamp))
            else:
                payload, encoding = sample.payload.to_bytes(), str(sample.encoding)
                if "*" in key:
                    raise ValueError("expected one key: a wildcard would replace what was checked under others")
                check(key.removeprefix(self._prefix), payload, encoding)
                self.pending.append(Put(key, payload, encoding, timestamp))
        except ValueError as error:
            raise BadPayloadError(f"{key}: {error}") from error
        if len(self.pending) >= BATCH:
            self.flush()

    def flush(self) -> None:
        """Write what has been collected; what cannot be written is given up, so that its sender, reading back, sees."""
        operations, self.pending = self.pending, []
        if not operations:
            return
        try:
            try:
                self._database.apply(operations)
            except StoreFullError:
                self._prune()
                self._database.apply(operations)
            self._until_prune -= len(operations)
            if self._until_prune <= 0:
                self._prune()
            self._service.phase = "running"
        except StoreError as error:
            self._service.phase = f"cannot write: {error}"[:200]
            self._service.refuse(StoreFailedError(f"{len(operations)} operations not stored: {error}"))

    def on_query(self, query: zenoh.Query) -> None:
        """Reply with every stored value that the query's key expression matches."""
        self.flush()
        as_json = False
        try:
            as_json = wants_json(parameters_of(query).get("format", "msgpack"))
            for value in self._database.get(str(query.key_expr)):
                _reply(query, value, as_json)
        except (StoreError, TreenailError) as error:
            refusal = Refusal(reason="bad_request", message=one_line(str(error), 1000))
            if as_json:
                query.reply_err(encode_json(refusal), encoding="application/json")
            else:
                query.reply_err(encode(refusal), encoding=encoding_of(Refusal))
            self._service.refuse(error if isinstance(error, TreenailError) else StoreFailedError(f"query: {error}"))

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
