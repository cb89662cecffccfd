"""Whom the store believes, what it takes, and what it says: its shell on a bus in memory, with a real file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

import pytest
import zenoh
from msgspec.structs import replace

from services.bus.fake_bus import FakeSample
from services.bus.testing import FakeService
from services.store.database import Database
from services.store.retention import RetentionSettings
from services.store.service import GONE, StoreShell
from services.store.sqlite_file import StoreFullError
from services.store.values import Put
from services.wire.codec import decode, encode, encoding_of
from services.wire.definition_file import definition_sha256, load, run_id
from services.wire.keys import ENTRY, HEAD, NEWEST_ENTRY, RUN, name_of, wild
from services.wire.messages import Complete, EpisodeSummary, JournalEpisode, Message, Refusal, RunRecord

TASK, OTHER = "7a", "bad"
DEFINITION = load("chamfered-q-softmax")
NAME = run_id(DEFINITION, 1)
RECORD = RunRecord(
    run=NAME,
    seed=1,
    definition=DEFINITION,
    definition_sha256=definition_sha256(DEFINITION),
    skill_sha256=None,
    contract_sha256="0f" * 32,
)


def entry(episode: int) -> JournalEpisode:
    summary = EpisodeSummary(
        run=NAME,
        episode=episode,
        episode_return=0.0,
        moves=3,
        decisions=0,
        mean_force_n=0.0,
        peak_force_n=0.0,
        mean_torque_nm=0.0,
        peak_torque_nm=0.0,
        states=0,
        outcome="inserted",
    )
    return JournalEpisode(run=NAME, episode=episode, first_decision=0, steps=(), summary=summary)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "store.sqlite"


@pytest.fixture
def database(file: Path) -> Iterator[Database]:
    with Database(file, max_bytes=1 << 20) as opened:
        yield opened


@pytest.fixture
def store(database: Database) -> FakeService:
    """A store beside a task that holds its role; it knows a run of three episodes."""
    service = FakeService("store")
    service.claim()
    service.hold("task", TASK)
    StoreShell(service, database, RetentionSettings()).open()
    service.hear(name_of(RUN, run=NAME), RECORD, TASK)
    for episode in range(3):
        service.hear(name_of(ENTRY, run=NAME, episode=episode), entry(episode), TASK)
    service.hear(name_of(NEWEST_ENTRY, run=NAME), entry(2), TASK)
    service.settle()
    assert not service.refused
    return service


def values(service: FakeService, name: str = "journal/**") -> dict[str, Message]:
    """Return what the store gives back, by key within the cell."""
    query = service.ask(f"{name}?complete")
    service.settle()
    *given, last = query.replies
    assert last.err is not None
    told = decode(Complete, last.err.payload.to_bytes(), str(last.err.encoding))
    assert told.values == len(given)
    found: dict[str, Message] = {}
    for reply in given:
        assert reply.ok is not None
        kind = RunRecord if str(reply.ok.encoding) == encoding_of(RunRecord) else JournalEpisode
        key = str(reply.ok.key_expr).removeprefix(service.keys.of(""))
        found[key] = decode(cast("type[Message]", kind), reply.ok.payload.to_bytes(), str(reply.ok.encoding))
    return found


def refusal(service: FakeService, name: str) -> str:
    query = service.ask(name)
    service.settle()
    (reply,) = query.replies
    assert reply.err is not None
    return decode(Refusal, reply.err.payload.to_bytes(), str(reply.err.encoding)).message


def remove(service: FakeService, name: str, sender: str, stamp: zenoh.Timestamp | None = None) -> None:
    """Let a delete come in."""
    key, when = zenoh.KeyExpr(service.keys.of(name)), stamp or service.bus.timestamp(sender)
    kind = zenoh.SampleKind.DELETE
    service.bus.put(FakeSample(key, zenoh.ZBytes(b""), zenoh.Encoding("zenoh/bytes"), when, kind))
    service.settle()


def test_nothing_is_told_from_nobody(store: FakeService) -> None:
    assert values(store, "journal/other/*") == {}
    assert set(values(store, name_of(HEAD, run=NAME))) == {name_of(RUN, run=NAME), name_of(NEWEST_ENTRY, run=NAME)}
    assert len(values(store)) == 5


@pytest.mark.parametrize("sender", ["task", "stranger"])
@pytest.mark.parametrize("name", ["**", "journal/**", name_of(RUN, run=NAME), name_of(ENTRY, run=NAME, episode=1)])
def test_nobody_can_delete_of_a_run(store: FakeService, name: str, sender: str) -> None:
    before = values(store)
    remove(store, name, TASK if sender == "task" else OTHER)
    assert values(store) == before
    if name != "**":  # of which the store only hears what it subscribes to
        assert sum(store.refused.values()) == 1


def test_a_delete_of_tomorrow_is_refused_and_changes_nothing_for_what_comes(store: FakeService) -> None:
    in_2040 = zenoh.Timestamp(zenoh.NTP64(2_208_988_800, 0), b"\1" * 16)
    for name in ("journal/**", name_of(ENTRY, run=NAME, episode=3), f"checkpoint/skill/{'0f' * 32}"):
        remove(store, name, OTHER, in_2040)
    assert sum(store.refused.values()) == 3
    store.hear(name_of(ENTRY, run=NAME, episode=3), entry(3), TASK)
    assert name_of(ENTRY, run=NAME, episode=3) in values(store)


def test_a_stranger_can_put_nothing_of_a_run(store: FakeService) -> None:
    before = values(store)
    far = entry(999_999)
    for name, message in (
        (name_of(NEWEST_ENTRY, run=NAME), far),
        (name_of(ENTRY, run=NAME, episode=999_999), far),
        (name_of(RUN, run=NAME), replace(RECORD, seed=2)),
    ):
        store.hear(name, message, OTHER)
    assert values(store) == before
    assert store.refused == {"StrangerError": 3}


def test_before_the_task_has_claimed_its_role_nobody_is_believed(database: Database) -> None:
    service = FakeService("store")
    service.claim()
    StoreShell(service, database, RetentionSettings()).open()
    service.hear(name_of(RUN, run=NAME), RECORD, TASK)
    assert values(service) == {}
    service.hold("task", TASK)
    service.hear(name_of(RUN, run=NAME), RECORD, TASK)
    assert set(values(service)) == {name_of(RUN, run=NAME)}
    service.bus.token(next(token for token in service.bus.tokens if "/claim/task/" in token), here=False)
    service.hear(name_of(NEWEST_ENTRY, run=NAME), entry(0), TASK)
    assert set(values(service)) == {name_of(RUN, run=NAME)}, "whoever has lost the role is not believed any more"


@pytest.mark.parametrize(
    "name", ["checkpoint/junk1", "journal/x", "checkpoint/skill/short", f"journal/{NAME}/swaps", "checkpoint/a/b/c/d"]
)
def test_a_key_of_no_contract_is_not_kept(store: FakeService, database: Database, name: str) -> None:
    before = len(database.keys("**"))
    store.hear_raw(name, b"x" * 100_000, "zenoh/bytes", OTHER)
    store.settle()
    assert len(database.keys("**")) == before
    assert store.refused == {"BadPayloadError": 1}


def test_a_value_of_the_future_put_again_as_it_is_is_no_offence(store: FakeService, database: Database) -> None:
    """Whoever reads one puts it again, under the name of who wrote it, so that his own clock follows."""
    key = store.keys.journal(NAME, 1)
    sample = FakeSample(
        zenoh.KeyExpr(key),
        zenoh.ZBytes(encode(entry(1))),
        zenoh.Encoding(encoding_of(JournalEpisode)),
        store.bus.timestamp("5e"),
    )
    store.bus.put(sample)
    store.settle()
    assert store.refused == {"StrangerError": 1}
    before = dict(store.refused)
    stored = store.ask(name_of(ENTRY, run=NAME, episode=1))
    store.settle()
    store.bus.token(next(token for token in store.bus.tokens if "/claim/task/" in token), here=False)
    given = stored.replies[0].ok
    assert given is not None
    store.bus.put(given)
    store.settle()
    assert dict(store.refused) == before


@pytest.mark.parametrize("how", [Path.unlink, lambda path: path.rename(path.with_suffix(".moved"))])
def test_a_file_that_is_gone_is_said_and_nothing_is_taken(
    store: FakeService, file: Path, how: Callable[[Path], Any]
) -> None:
    how(file)
    store.hear(name_of(ENTRY, run=NAME, episode=3), entry(3), TASK)
    assert refusal(store, "journal/**") == f"{file}: {GONE}"
    assert store.phase.startswith(f"cannot write: {file}")
    assert store.refused["StoreFailedError"] >= 1


def test_a_full_store_says_so_until_it_has_written_something(store: FakeService, database: Database) -> None:
    others = [f"other/{number:04}" for number in range(400)]
    with suppress(StoreFullError):
        for key in others:
            database.apply([Put(key, key.encode() * 500, "e", f"{9:016x}/{'01' * 16}")])
    for episode in range(3, 63):
        store.hear(name_of(ENTRY, run=NAME, episode=episode), entry(episode), TASK)
    for _ in range(2):
        values(store)
        assert store.phase.startswith("cannot write: ")
        assert "expected room for the batch" in store.phase
    database.prune(others)
    store.hear(name_of(ENTRY, run=NAME, episode=3), entry(3), TASK)
    values(store)
    assert store.phase.startswith("running, ")


def test_how_much_room_is_taken_is_in_the_phase(store: FakeService) -> None:
    values(store)
    assert store.phase.startswith("running, ")
    assert store.phase.endswith(" of at most 1 MB")


def test_damage_that_comes_up_while_it_runs_is_named(store: FakeService, database: Database, file: Path) -> None:
    values(store)
    database._connection.execute("UPDATE entry SET timestamp = replace(timestamp, '0', '1') WHERE key LIKE '%00000001'")
    said = refusal(store, wild(ENTRY))
    assert said.startswith(f"{file}: damaged: episode 1 of run {NAME}, of which episodes 0, 2 can still be had; ")
    assert "treenail store salvage" in said
