"""The run's journal in the store: one entry an episode, confirmed by reading it back before the next one begins."""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple, TypeVar

from services.bus.service import Service
from services.wire.codec import decode
from services.wire.errors import CellError, ContractError, NoAnswerError
from services.wire.keys import CONTRACT, ENTRY, HEAD, NEWEST_ENTRY, RUN, SWAPS, name_of, named
from services.wire.messages import JournalEpisode, Message, RunRecord, Swap, Swaps
from services.wire.text import one_line

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
        try:
            if read(service, read_back, type(expected)) == expected:
                return True
            why = "it does not confirm what it was given"
        except NoAnswerError as error:
            why = str(error)
        wait_for_store(service, why)
    return False


def wait_for_store(service: Service, why: str) -> None:
    """Say that the store is waited for, and wait a moment."""
    service.phase = one_line(f"waiting for store ({why})", 200)
    service.complain(service.phase)
    service.work_until(lambda: False, RETRY_S)


def read(service: Service, name: str, kind: type[M]) -> M | None:
    """Return what the store has under a name; None when it says that there is nothing.

    Raises NoAnswerError when it says neither, and CellError when what it has cannot be read.
    """
    try:
        messages = service.stored(name, kind)
    except ContractError as error:
        raise CellError(f"store: {name} cannot be read: {error}") from error
    return messages[0] if messages else None


class Place(NamedTuple):
    """Where a run stands in the store."""

    newest: JournalEpisode | None = None
    """Its newest episode; None for a new run."""
    swaps: tuple[Swap, ...] = ()


class Journal:
    """What the store knows of one run."""

    def __init__(self, service: Service, record: RunRecord) -> None:
        self._service = service
        self._record = record

    def resume(self) -> tuple[Place, bool]:
        """Make the store know the run; return where the run stands in it, and whether to go on.

        Waits for the store as long as it takes. Raises CellError when the store knows the run under another contract.
        """
        if not self.make_known():
            return Place(), False
        service = self._service
        while not service.stopping:
            try:
                return self._read_place(), True
            except NoAnswerError as error:
                wait_for_store(service, str(error))
        return Place(), False

    def make_known(self) -> bool:
        """Make the store know the run, waiting for it as long as it takes; False when stopped meanwhile.

        Nothing is put before the store has said what it knows. Raises CellError when it knows the run under another
        contract.
        """
        service, name = self._service, name_of(RUN, run=self._record.run)
        while not service.stopping:
            try:
                record = read(service, name, RunRecord)
            except NoAnswerError as error:
                wait_for_store(service, str(error))
                continue
            self._check(record)
            return put_and_confirm(service, ((service.keys.run_record(self._record.run), self._record),), name)
        return False

    def _check(self, record: RunRecord | None) -> None:
        service = self._service
        if record is not None and record.contract_sha256 != service.contract:
            ours, theirs = service.contract[:12], record.contract_sha256[:12]
            raise CellError(
                f"store: run {record.run} was recorded with contract {theirs}, this is {ours}; "
                "start with an empty store, or with the version that recorded it"
            )

    def known(self) -> bool:
        """Return whether the store, at this moment, answers that it knows the run: it does unless it is gone."""
        with suppress(NoAnswerError):
            return read(self._service, name_of(RUN, run=self._record.run), RunRecord) == self._record
        return False

    def append(self, entry: JournalEpisode) -> bool:
        """Store an episode and wait until it can be read back, as long as it takes; False when stopped meanwhile.

        A store that confirms the episode but does not know the run has lost what came before: then it is waited for
        one that has it.
        """
        service, run = self._service, self._record.run
        while not service.stopping:
            service.put(service.keys.journal(run, entry.episode), entry)
            service.put(service.keys.journal_latest(run), entry)
            why = "it does not confirm what it was given"
            try:
                head = self._head()
                if RUN in head and head.get(NEWEST_ENTRY) == entry:
                    return True
                if RUN not in head:
                    why = (
                        f"it has lost run {run}: was its file exchanged? Stop the cell and start it with the right one"
                    )
            except NoAnswerError as error:
                why = str(error)
            wait_for_store(service, why)
        return False

    def _head(self) -> dict[str, Message]:
        """Return what the store has of the run beside its episodes, by key of the contract.

        Raises NoAnswerError, and CellError for what cannot be read.
        """
        service, head = self._service, {}
        for sample in service.fetch_stored(name_of(HEAD, run=self._record.run)):
            key = named(str(sample.key_expr).removeprefix(service.keys.of("")))
            if key is not None:
                (kind,) = CONTRACT[key.pattern].types
                try:
                    head[key.pattern] = decode(kind, sample.payload.to_bytes(), str(sample.encoding))
                except ContractError as error:
                    raise CellError(f"store: {sample.key_expr} cannot be read: {error}") from error
        return head

    def _read_place(self) -> Place:
        """Return the newest episode and the swaps. Raises NoAnswerError while the store does not know the run."""
        head = self._head()
        if RUN not in head:
            raise NoAnswerError(f"no memory of run {self._record.run}")
        newest, swaps = head.get(NEWEST_ENTRY), head.get(SWAPS)
        newest = newest if isinstance(newest, JournalEpisode) else None
        following = 0 if newest is None else newest.episode + 1
        # The entry itself is put before "latest": a task that died in between left it there.
        entry = read(self._service, name_of(ENTRY, run=self._record.run, episode=following), JournalEpisode)
        return Place(entry or newest, swaps.swaps if isinstance(swaps, Swaps) else ())
