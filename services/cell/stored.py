"""What a store has: runs, what was learnt in them, and skills; read alike from a living cell and from a file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import NamedTuple, Protocol, TypeVar

from services.cell.client import Client
from services.rules import skill as skills_on_wire
from services.rules.skill import NamedSkill
from services.wire.codec import contract_sha256, decode
from services.wire.errors import CellError, ContractError, GapError, NoAnswerError, RefusedError, WrongVersionError
from services.wire.keys import (
    CHECKPOINT,
    ENTRY,
    EXPERIMENT,
    JOURNAL_BLOCK,
    LATEST,
    NEWEST_ENTRY,
    RUN,
    SKILL,
    SWAPS,
    name_of,
    wild,
)
from services.wire.messages import Checkpoint, Experiment, JournalEpisode, Message, RunRecord, Swap, Swaps

M = TypeVar("M", bound=Message)

WITHIN_S = 30.0
"""How long a store has for an answer that may be large."""
LISTED = 10
"""Runs that an error names."""
OTHER_VERSION = "use the version of Treenail that recorded it"


class OtherContractError(CellError):
    """A run that was recorded under another contract."""


class Value(NamedTuple):
    """What a store has under a key; ``name`` is the key within the cell."""

    name: str
    payload: bytes
    encoding: str
    when: int = 0
    """When it was put, in Zenoh's units."""


class Stored(Protocol):
    """What one cell's store has."""

    where: str
    """What it is, for people."""

    def values(self, expression: str) -> list[Value]:
        """Return all values whose names within the cell a key expression matches, by name. Raises CellError."""

    def working_on(self) -> str | None:
        """Return the run that a task is working on just now, if one is. Raises NoAnswerError when no store is there."""


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
            Value(
                str(sample.key_expr).removeprefix(prefix),
                sample.payload.to_bytes(),
                str(sample.encoding),
                0 if sample.timestamp is None else int(str(sample.timestamp.get_time_as_ntp64())),
            )
            for sample in samples
        ]

    def working_on(self) -> str | None:
        """Return what the task says; see ``Stored``."""
        if "store" not in self.client.alive():
            raise self.client.no_answer(wild(RUN))
        with suppress(NoAnswerError, RefusedError):
            return self.client.ask(EXPERIMENT, Experiment).run
        return None


class StoredCheckpoint(NamedTuple):
    """A checkpoint, its name in the store, and the size of its payload."""

    name: str
    checkpoint: Checkpoint
    size_bytes: int


class StoredRun:
    """A run in a store. Everything raises CellError when the store fails, and ContractError for what is damaged."""

    def __init__(self, stored: Stored, name: str, changed: int = 0) -> None:
        self.stored = stored
        self.name = name
        self.changed = changed
        """When the store was given something of it last, in Zenoh's units; a run that is taken up again counts."""

    def record(self) -> RunRecord:
        """Return what the run is. Raises OtherContractError when it was recorded under another contract."""
        found = self._messages(name_of(RUN, run=self.name), RunRecord)
        if len(found) != 1:
            raise NoAnswerError(f"{self.stored.where}: expected the record of run {self.name}, got none")
        ours, theirs = contract_sha256(), found[0].contract_sha256
        if theirs != ours:
            raise OtherContractError(
                f"run {self.name}: expected contract {ours[:12]}, got {theirs[:12]}; {OTHER_VERSION}"
            )
        return found[0]

    def skill(self, sha256: str | None) -> NamedSkill | None:
        """Return the skill of a name; None for None. Raises NoAnswerError when the store does not have it."""
        if sha256 is None:
            return None
        for value in self.stored.values(name_of(SKILL, sha256=sha256)):
            try:
                found = skills_on_wire.decode(value.payload, value.encoding)
            except ContractError as error:
                raise type(error)(f"{self.stored.where}: {value.name}: {error}") from None
            if found.sha256 == sha256:
                return found
        raise NoAnswerError(f"run {self.name}: expected skill {sha256[:12]}, that it began with, got none")

    def swaps(self) -> tuple[Swap, ...]:
        """Return all swaps of the run, those for episodes to come among them."""
        found = self._messages(name_of(SWAPS, run=self.name), Swaps)
        return found[0].swaps if found else ()

    def newest_bytes(self) -> int:
        """Return the size of the newest episode's entry."""
        return sum(len(value.payload) for value in self.stored.values(name_of(NEWEST_ENTRY, run=self.name)))

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

    def episodes(self, until: int | None = None, first: int = 0) -> Iterator[JournalEpisode]:
        """Give all episodes from ``first`` to before ``until``, by default all now, in order. Raises GapError."""
        length = self.length()
        end = length if until is None else until
        if end > length:
            raise GapError(f"run {self.name}: expected {end} episodes or more in the journal, got {length}")
        following = first
        while following < end:
            name = name_of(ENTRY, run=self.name, block=following // JOURNAL_BLOCK)
            entries = [entry for entry in self._messages(name, JournalEpisode) if entry.episode >= following]
            if not entries:
                raise self._gap(following, f"none; there are {length}")
            for entry in entries[: end - following]:
                if entry.episode != following:
                    raise self._gap(following, f"episode {entry.episode}")
                yield entry
                following += 1

    def checkpoints(self) -> list[StoredCheckpoint]:
        """Return all checkpoints of its workers with their names in the store, oldest first, the newest twice."""
        found = [
            StoredCheckpoint(value.name, self._message(value, Checkpoint), len(value.payload))
            for value in self.stored.values(name_of(CHECKPOINT, run=self.name))
        ]
        return sorted(found, key=lambda one: (one.checkpoint.service, one.checkpoint.episode, one.name))

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


class StoredSkills(NamedTuple):
    """The skills in a store by name, with the size of each, and which one the next run begins with."""

    found: dict[str, tuple[NamedSkill, int]]
    chosen: str | None


def runs(stored: Stored) -> list[StoredRun]:
    """Return the runs in a store, the one that was worked on last first, whatever version recorded them.

    Raises CellError, NoAnswerError without a store among them.
    """
    changed: dict[str, int] = {}
    records = stored.values(wild(RUN))
    for value in (*records, *(stored.values(wild(NEWEST_ENTRY)) if records else ())):
        run = value.name.split("/")[1]
        changed[run] = max(changed.get(run, 0), value.when)
    if not records:
        stored.working_on()  # raises without a store
    there = {value.name.split("/")[1] for value in records}
    return [StoredRun(stored, name, changed[name]) for name in sorted(there, key=lambda run: (-changed[run], run))]


def run_named(stored: Stored, name: str | None) -> StoredRun:
    """Return a run as ``chosen`` does, by default the one that a task works on, or else the last one worked on."""
    if name is None:
        known = runs(stored)
        working = stored.working_on() if len(known) > 1 else None
        name = working or (known[0].name if known else None)
    return chosen([stored], name)


def skills(stored: Stored) -> StoredSkills:
    """Return the skills in a store; those of another contract are left out."""
    found: dict[str, tuple[NamedSkill, int]] = {}
    chosen = None
    for value in stored.values(wild(SKILL)):
        with suppress(ContractError):
            skill = skills_on_wire.decode(value.payload, value.encoding)
            found[skill.sha256] = (skill, len(value.payload))
            if value.name == name_of(SKILL, sha256=LATEST):
                chosen = skill.sha256
    return StoredSkills(found, chosen)


def chosen(places: Sequence[Stored], name: str | None) -> StoredRun:
    """Return the run whose name is ``name`` or alone begins so; without a name the only one. Raises CellError."""
    known = sorted((run for stored in places for run in runs(stored)), key=lambda run: run.name)
    if not known:
        raise CellError(f"{places[0].where}: expected a run, got none")
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
