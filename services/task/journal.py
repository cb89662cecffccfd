"""The run's journal in the store: one entry an episode, confirmed by reading it back before the next one begins."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

from services.bus.service import Service
from services.wire.codec import decode
from services.wire.errors import CellError, ContractError
from services.wire.keys import ENTRY, HEAD, NEWEST_ENTRY, RUN, name_of
from services.wire.messages import JournalEpisode, Message, RunRecord, Swap, Swaps

RETRY_S = 0.5

M = TypeVar("M", bound=Message)


def put_and_confirm(service: Service, puts: tuple[tuple[str, Message], ...], read_back: str) -> bool:
    """Put messages on full keys until the last can be read back from its name, as long as it takes; False if stopped.

    Raises CellError when what the store gives back cannot be read.
    """
    expected = puts[-1][1]
    while not service.stopping:
        for key, message in puts:
            service.put(key, message)
        if read(service, read_back, type(expected)) == expected:
            return True
        service.phase = "waiting for store (it does not confirm what it was given)"
        service.complain(service.phase)
        service.work_until(lambda: False, RETRY_S)
    return False


def read(service: Service, name: str, kind: type[M]) -> M | None:
    """Return what the store has under a name, or None. Raises CellError when it cannot be read."""
    try:
        found = service.fetch_all(name, kind)
    except ContractError as error:
        raise CellError(f"store: {name} cannot be read: {error}") from error
    return found[0] if found else None


class Found(NamedTuple):
    """Where a run stands in the store."""

    newest: JournalEpisode | None = None
    """Its newest episode; None for a new run."""
    swaps: tuple[Swap, ...] = ()


class Journal:
    """What the store knows of one run."""

    def __init__(self, service: Service, record: RunRecord) -> None:
        self._service = service
        self._record = record

    def resume(self) -> tuple[Found, bool]:
        """Make the store know the run; return where the run stands in it, and whether to go on.

        Waits for the store as long as it takes. Raises CellError when the store knows the run under another contract.
        """
        service, run = self._service, self._record.run
        if not self.make_known():
            return Found(), False
        found = service.wait_for("store (no memory of this run)", self._found)
        if found is None:
            return Found(), False
        newest = found.newest
        following = 0 if newest is None else newest.episode + 1
        # The entry itself is put before "latest": a task that died in between left it there.
        entry = read(service, name_of(ENTRY, run=run, episode=following), JournalEpisode)
        return Found(entry or newest, found.swaps), True

    def make_known(self) -> bool:
        """Make the store know the run, waiting for it as long as it takes; False when stopped meanwhile.

        Raises CellError when the store knows the run under another contract.
        """
        service, run = self._service, self._record.run
        known = read(service, name_of(RUN, run=run), RunRecord)
        if known is not None and known.contract_sha256 != service.contract:
            ours, theirs = service.contract[:12], known.contract_sha256[:12]
            raise CellError(
                f"store: run {run} was recorded with contract {theirs}, this is {ours}; "
                "start with an empty store, or with the version that recorded it"
            )
        return put_and_confirm(service, ((service.keys.run_record(run), self._record),), name_of(RUN, run=run))

    def known(self) -> bool:
        """Return whether the store, at this moment, answers that it knows the run: it does unless it is gone."""
        return read(self._service, name_of(RUN, run=self._record.run), RunRecord) == self._record

    def append(self, entry: JournalEpisode) -> bool:
        """Store an episode and wait until it can be read back, as long as it takes; False when stopped meanwhile."""
        keys, run = self._service.keys, self._record.run
        puts = ((keys.journal(run, entry.episode), entry), (keys.journal_latest(run), entry))
        return put_and_confirm(self._service, puts, name_of(NEWEST_ENTRY, run=run))

    def _found(self) -> Found | None:
        """Return the newest episode and the swaps, or None while the store does not know the run.

        All is asked for at once: a store that is just gone must not pass for one that has no episode yet.
        """
        service, run = self._service, self._record.run
        samples = {str(sample.key_expr): sample for sample in service.fetch_samples(name_of(HEAD, run=run))}
        if service.keys.run_record(run) not in samples:
            return None
        newest, swaps = samples.get(service.keys.journal_latest(run)), samples.get(service.keys.swaps(run))
        return Found(
            None if newest is None else decode(JournalEpisode, newest.payload.to_bytes(), str(newest.encoding)),
            () if swaps is None else decode(Swaps, swaps.payload.to_bytes(), str(swaps.encoding)).swaps,
        )
