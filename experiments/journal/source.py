"""Where journals come from: a store's file, or a living cell over Zenoh; and the runs that are found there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol, TypeVar

from experiments.journal.store_file import StoreFile, Value
from services.cell.client import Client
from services.rules import skill as skills
from services.rules.skill import NamedSkill
from services.wire.codec import contract_sha256, decode
from services.wire.errors import CellError, ContractError, GapError, NoAnswerError, RefusedError, WrongVersionError
from services.wire.keys import CHECKPOINT, ENTRY, JOURNAL_BLOCK, NEWEST_ENTRY, RUN, SKILL, SWAPS, name_of, wild
from services.wire.messages import Checkpoint, JournalEpisode, Message, RunRecord, Swap, Swaps

M = TypeVar("M", bound=Message)

WITHIN_S = 30.0
"""How long a store has for an answer that may be large."""
LISTED = 10
"""Runs that an error names."""
OTHER_VERSION = "use the version of Treenail that recorded it"


class Stored(Protocol):
    """What one cell's store has."""

    where: str
    """What it is, for people."""

    def values(self, expression: str) -> list[Value]:
        """Return all values whose names within the cell a key expression matches, by name. Raises CellError."""

    def without_runs(self) -> CellError:
        """Return what to say when no run is found in it."""


class InFile:
    """One cell's part of a store's file."""

    def __init__(self, file: StoreFile, cell: str) -> None:
        self._file = file
        self._cell = cell
        self.path = file.path
        self.where = f"{file.path}, cell {cell}"

    def values(self, expression: str) -> list[Value]:
        """Return what matches; see ``Stored``."""
        return self._file.values(self._cell, expression)

    def without_runs(self) -> CellError:
        """Return what to say when no run is found in it."""
        return CellError(f"{self.where}: expected a run, got none")


class InCell:
    """The store of a living cell."""

    def __init__(self, client: Client) -> None:
        self.client = client
        self.where = f"cell {client.keys.cell}"

    def values(self, expression: str) -> list[Value]:
        """Return what matches; see ``Stored``."""
        samples, refusals = self.client.replies(expression, WITHIN_S)
        if refusals:
            raise RefusedError(f"{self.client.keys.of(expression)}: {refusals[0]}")
        prefix = self.client.keys.of("")
        return [
            Value(str(sample.key_expr).removeprefix(prefix), sample.payload.to_bytes(), str(sample.encoding))
            for sample in samples
        ]

    def without_runs(self) -> CellError:
        """Return what to say when no run is found in it: there may be no store."""
        if "store" not in self.client.alive():
            return self.client.no_answer(wild(RUN))
        return CellError(f"{self.where}: expected a run in its store, got none so far")


class StoredRun:
    """A run in a store. Everything raises CellError when the store fails, and ContractError for what is damaged."""

    def __init__(self, stored: Stored, name: str) -> None:
        self.stored = stored
        self.name = name

    def record(self) -> RunRecord:
        """Return what the run is. Raises CellError when it was recorded under another contract."""
        found = self._messages(name_of(RUN, run=self.name), RunRecord)
        if len(found) != 1:
            raise NoAnswerError(f"{self.stored.where}: expected the record of run {self.name}, got none")
        ours, theirs = contract_sha256(), found[0].contract_sha256
        if theirs != ours:
            raise CellError(f"run {self.name}: expected contract {ours[:12]}, got {theirs[:12]}; {OTHER_VERSION}")
        return found[0]

    def skill(self, sha256: str | None) -> NamedSkill | None:
        """Return the skill of a name; None for None. Raises NoAnswerError when the store does not have it."""
        if sha256 is None:
            return None
        for value in self.stored.values(name_of(SKILL, sha256=sha256)):
            try:
                found = skills.decode(value.payload, value.encoding)
            except ContractError as error:
                raise type(error)(f"{self.stored.where}: {value.name}: {error}") from None
            if found.sha256 == sha256:
                return found
        raise NoAnswerError(f"run {self.name}: expected skill {sha256[:12]}, that it began with, got none")

    def swaps(self) -> tuple[Swap, ...]:
        """Return all swaps of the run, those for episodes to come among them."""
        found = self._messages(name_of(SWAPS, run=self.name), Swaps)
        return found[0].swaps if found else ()

    def newest(self) -> JournalEpisode | None:
        """Return the newest episode, as the store has it under ``latest``; None before the first."""
        found = self._messages(name_of(NEWEST_ENTRY, run=self.name), JournalEpisode)
        return found[0] if found else None

    def length(self) -> int:
        """Return how many episodes there are. Raises GapError when there are more than the newest is said to be."""
        before = None
        while True:
            newest = self.newest()
            following = 0 if newest is None else newest.episode + 1
            block = self.stored.values(name_of(ENTRY, run=self.name, block=following // JOURNAL_BLOCK))
            numbers = [int(name) for value in block if (name := value.name.rpartition("/")[2]).isdigit()]
            length = max(following, *(number + 1 for number in numbers), 0)
            # The entry itself is put before "latest": a task that died in between left it there.
            if length <= following + 1:
                return length
            if before == following:
                expected = f"{following} episodes in the journal, as its newest entry says"
                raise GapError(f"run {self.name}: expected {expected}, got episode {length - 1}")
            before = following  # a living run may have gone on meanwhile

    def episodes(self, until: int | None = None) -> Iterator[JournalEpisode]:
        """Give all episodes before ``until``, by default all there are now, in order. Raises GapError."""
        length = self.length()
        end = length if until is None else until
        if end > length:
            raise GapError(f"run {self.name}: expected {end} episodes or more in the journal, got {length}")
        following = 0
        while following < end:
            name = name_of(ENTRY, run=self.name, block=following // JOURNAL_BLOCK)
            entries = self._messages(name, JournalEpisode)[following % JOURNAL_BLOCK :]
            if not entries:
                raise self._gap(following, f"none; there are {length}")
            for entry in entries[: end - following]:
                if entry.episode != following:
                    raise self._gap(following, f"episode {entry.episode}")
                yield entry
                following += 1

    def checkpoints(self) -> list[tuple[str, Checkpoint]]:
        """Return all checkpoints of its workers with their names in the store, oldest first, the newest twice."""
        found = []
        for value in self.stored.values(name_of(CHECKPOINT, run=self.name)):
            found.append((value.name, self._message(value, Checkpoint)))
        return sorted(found, key=lambda one: (one[1].service, one[1].episode, one[0]))

    def _gap(self, episode: int, got: str) -> GapError:
        return GapError(f"run {self.name}: expected episode {episode} in the journal, got {got}")

    def _messages(self, expression: str, kind: type[M]) -> list[M]:
        return [self._message(value, kind) for value in self.stored.values(expression)]

    def _message(self, value: Value, kind: type[M]) -> M:
        try:
            return decode(kind, value.payload, value.encoding)
        except ContractError as error:
            hint = f"; {OTHER_VERSION}" if isinstance(error, WrongVersionError) else ""
            raise type(error)(f"{self.stored.where}: {value.name}: {error}{hint}") from None


def runs(stored: Stored) -> list[StoredRun]:
    """Return the runs in a store, by name, whatever version of Treenail recorded them."""
    return [StoredRun(stored, value.name.split("/")[1]) for value in stored.values(wild(RUN))]


def chosen(places: Sequence[Stored], name: str | None) -> StoredRun:
    """Return the run whose name is ``name`` or alone begins so; without a name the only one. Raises CellError."""
    known = [run for stored in places for run in runs(stored)]
    if not known:
        raise places[0].without_runs()
    exact = [run for run in known if run.name == name]
    fitting = exact or [run for run in known if run.name.startswith(name or "")]
    if len(fitting) == 1:
        return fitting[0]
    listed = fitting or known
    several = len({run.stored.where for run in listed}) > 1
    words = [f"{run.name} ({run.stored.where})" if several else run.name for run in listed]
    there = ", ".join(words[:LISTED]) + (f" and {len(words) - LISTED} more" if len(words) > LISTED else "")
    if not fitting:
        raise CellError(f"run: expected one of {there}, got {name!r}")
    if name is None:
        raise CellError(f"run: expected to be told which one of {there}")
    raise CellError(f"run: expected the name of one run, got {name!r}, which fits {there}")
