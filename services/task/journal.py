"""The run's journal in the store: one entry an episode, confirmed by reading it back before the next one begins."""

from __future__ import annotations

from typing import TypeVar

from services.wire.codec import decode
from services.wire.errors import CellError, ContractError
from services.wire.keys import LATEST
from services.wire.messages import JournalEpisode, Message, RunRecord
from services.wire.service import Service

RETRY_S = 0.5

M = TypeVar("M", bound=Message)


class Journal:
    """What the store knows of one run."""

    def __init__(self, service: Service, record: RunRecord) -> None:
        self._service = service
        self._record = record

    def resume(self) -> tuple[JournalEpisode | None, bool]:
        """Make the store know the run; return its newest episode (None for a new run) and whether to go on.

        Waits for the store as long as it takes. Raises CellError when the store knows the run under another contract.
        """
        service, run = self._service, self._record.run
        known = self._read(f"journal/{run}/run", RunRecord)
        if known is not None and known.contract_sha256 != service.contract:
            ours, theirs = service.contract[:12], known.contract_sha256[:12]
            raise CellError(
                f"store: run {run} was recorded with contract {theirs}, this is {ours}; "
                "start with an empty store, or with the version that recorded it"
            )
        if not self._put_and_confirm(((service.keys.run_record(run), self._record),), f"journal/{run}/run"):
            return None, False
        entries = service.wait_for("store (no memory of this run)", self._newest)
        if entries is None:
            return None, False
        newest = entries[0] if entries else None
        following = 0 if newest is None else newest.episode + 1
        # The entry itself is put before "latest": a task that died in between left it there.
        key = service.keys.journal(run, following).removeprefix(service.keys.of(""))
        return self._read(key, JournalEpisode) or newest, True

    def append(self, entry: JournalEpisode) -> bool:
        """Store an episode and wait until it can be read back, as long as it takes; False when stopped meanwhile."""
        keys, run = self._service.keys, self._record.run
        puts = ((keys.journal(run, entry.episode), entry), (keys.journal_latest(run), entry))
        return self._put_and_confirm(puts, f"journal/{run}/{LATEST}")

    def _put_and_confirm(self, puts: tuple[tuple[str, Message], ...], read_back: str) -> bool:
        service, expected = self._service, puts[-1][1]
        while not service.stopping:
            for key, message in puts:
                service.put(key, message)
            if self._read(read_back, type(expected)) == expected:
                return True
            service.phase = "waiting for store (it does not confirm what it was given)"
            service.complain(service.phase)
            service.work_until(lambda: False, RETRY_S)
        return False

    def _newest(self) -> list[JournalEpisode] | None:
        """Return the newest episode if there is one, or None while the store does not know the run.

        Both are asked for at once: a store that is just gone must not pass for one that has no episode yet.
        """
        service, run = self._service, self._record.run
        samples = {str(sample.key_expr): sample for sample in service.fetch_samples(f"journal/{run}/*")}
        if service.keys.run_record(run) not in samples:
            return None
        sample = samples.get(service.keys.journal_latest(run))
        if sample is None:
            return []
        return [decode(JournalEpisode, sample.payload.to_bytes(), str(sample.encoding))]

    def _read(self, name: str, kind: type[M]) -> M | None:
        try:
            found = self._service.fetch_all(name, kind)
        except ContractError as error:
            raise CellError(f"store: {name} cannot be read: {error}") from error
        return found[0] if found else None
