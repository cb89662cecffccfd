"""The store's database, on real files, against reference models, killed processes and full disks."""

from __future__ import annotations

import json
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from textwrap import dedent

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from zenoh import NTP64, KeyExpr, Timestamp

from services.store import database
from services.store.database import Database
from services.store.sqlite_file import APPLICATION_ID, StoreBusyError, StoreFileError, StoreFullError
from services.store.values import Delete, Put, StoredKey, StoredValue, key_range, timestamp_text, zenoh_timestamp

MEGABYTE = 1 << 20
CHUNKS = st.sampled_from(["a", "b", "ab", "a-b", "@a", "é"])
KEYS = st.lists(CHUNKS, min_size=1, max_size=4).map("/".join)
WILD_CHUNKS = st.sampled_from(["a", "b", "@a", "é", "*", "**", "a$*", "$*b"])
EXPRESSIONS = st.lists(WILD_CHUNKS, min_size=1, max_size=4).map("/".join).map(KeyExpr.autocanonize).map(str)
IDENTIFIERS = st.binary(min_size=1, max_size=16).filter(any)


def at(time: int) -> str:
    return f"{time:016x}/{'01' * 16}"


def put(key: str, time: int, payload: bytes = b"payload", encoding: str = "application/octet-stream") -> Put:
    return Put(key, payload, encoding, at(time))


def delete(key: str, time: int) -> Delete:
    return Delete(key, at(time))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "store.db"


@pytest.fixture
def store(file: Path) -> Iterator[Database]:
    with Database(file) as opened:
        yield opened


def test_what_was_put_comes_back_after_reopening(file: Path) -> None:
    with Database(file) as store:
        assert store.apply([put("a/b", 5, b"\0\xff", "x/y;schema=z"), put("a/é", 6, b"")]) == 2
    with Database(file) as store:
        assert store.get("a/b").values == [StoredValue("a/b", b"\0\xff", "x/y;schema=z", at(5))]
        assert store.get("a/*").values == [
            StoredValue("a/b", b"\0\xff", "x/y;schema=z", at(5)),
            StoredValue("a/é", b"", "application/octet-stream", at(6)),
        ]
        assert store.keys("**") == [StoredKey("a/b", 2, at(5)), StoredKey("a/é", 0, at(6))]
        assert store.get("a/c").values == []
        assert store.apply([]) == 0


@pytest.mark.parametrize("text", ["", "/a", "a/", "a//b", "a/**/**", "a*", "a#", "a?b"])
def test_text_that_is_no_canonical_key_expression_is_refused(store: Database, text: str) -> None:
    with pytest.raises(ValueError, match="canonical"):
        Put(text, b"", "", at(1))
    with pytest.raises(ValueError, match="canonical"):
        Delete(text, at(1))
    with pytest.raises(ValueError, match="canonical"):
        store.get(text)


@pytest.mark.parametrize("text", ["", "1/33", at(1).upper().replace("1", "A"), at(1) + "0", f"{1:016x}/{'0' * 32}"])
def test_text_that_is_no_timestamp_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="timestamp: expected"):
        Put("a", b"", "", text)
    with pytest.raises(ValueError, match="timestamp: expected"):
        zenoh_timestamp(text)


# -- timestamps


@given(st.lists(st.tuples(st.integers(0, 2**32 - 1), st.integers(0, 3), IDENTIFIERS), min_size=2, max_size=6))
def test_texts_sort_as_timestamps_do(parts: list[tuple[int, int, bytes]]) -> None:
    stamps = [Timestamp(NTP64(seconds, nanoseconds), identifier) for seconds, nanoseconds, identifier in parts]
    for one in stamps:
        for other in stamps:
            assert (timestamp_text(one) >= timestamp_text(other)) == (one >= other)
            assert (timestamp_text(one) == timestamp_text(other)) == (one == other)


@given(st.integers(0, 2**32 - 1), st.integers(0, 10**9 - 1), IDENTIFIERS)
def test_a_timestamp_of_whole_nanoseconds_comes_back_exactly(seconds: int, nanoseconds: int, identifier: bytes) -> None:
    stamp = Timestamp(NTP64(seconds, nanoseconds), identifier)
    assert zenoh_timestamp(timestamp_text(stamp)) == stamp
    assert str(zenoh_timestamp(timestamp_text(stamp))) == str(stamp)


@given(st.integers(0, 2**64 - 1))
def test_any_other_timestamp_comes_back_as_the_next_nanosecond(time: int) -> None:
    found = timestamp_text(zenoh_timestamp(at(time)))
    assert found[16:] == at(time)[16:]
    late = int(found[:16], 16) - time
    # A nanosecond is 4.29 units; the last one of 2106 has nothing after it.
    assert 0 <= late <= 4 or (time > 2**64 - 5 and -5 < late < 0)
    assert zenoh_timestamp(found) == zenoh_timestamp(at(time))


# -- key expressions


@settings(max_examples=400)
@given(EXPRESSIONS, KEYS)
def test_every_key_that_intersects_is_in_the_range(expression: str, key: str) -> None:
    low, high = key_range(expression)
    if KeyExpr(expression).intersects(key):
        assert low.encode() <= key.encode()
        assert high == b"" or key.encode() < str(high).encode()


@settings(max_examples=30, deadline=None)
@given(st.sets(KEYS, max_size=40), st.lists(EXPRESSIONS, min_size=1, max_size=30))
def test_get_finds_what_zenoh_says_intersects(
    tmp_path_factory: pytest.TempPathFactory, keys: set[str], expressions: list[str]
) -> None:
    with Database(tmp_path_factory.mktemp("get") / "store.db") as store:
        store.apply([put(key, 1) for key in sorted(keys)])
        for expression in [*expressions, *keys]:
            wanted = sorted(key for key in keys if KeyExpr(expression).intersects(key))
            assert [value.key for value in store.get(expression).values] == wanted
            assert [stored.key for stored in store.keys(expression)] == wanted


def test_a_block_is_found_without_looking_at_the_rest(store: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    store.apply([put(f"treenail/a/journal/r/{n // 10:06}/{n:08}", 1) for n in range(1000)])
    looked_at: list[str] = []
    expression = KeyExpr("treenail/a/journal/r/000012/*")

    class Watched:
        def intersects(self, key: str) -> bool:
            looked_at.append(key)
            return expression.intersects(key)

    monkeypatch.setattr(database, "key_expression", lambda text: Watched())
    assert len(store.get(str(expression)).values) == 10
    assert len(looked_at) == 10


# -- which operation wins


@pytest.mark.parametrize(
    ("operations", "shown", "effective"),
    [
        ([put("k", 5, b"new"), put("k", 4, b"old")], b"new", 1),
        ([put("k", 5, b"first"), put("k", 5, b"again")], b"first", 1),
        ([put("k", 5), delete("k", 6), put("k", 4)], None, 2),
        ([delete("k", 6), put("k", 5)], None, 0),
        ([delete("k", 6), delete("k", 3), put("k", 5)], None, 0),
        ([put("k", 5, b"p"), delete("k", 4)], b"p", 1),
        ([delete("k", 6), put("k", 7, b"p")], b"p", 1),
    ],
)
def test_the_newest_wins(store: Database, operations: list[Put | Delete], shown: bytes | None, effective: int) -> None:
    assert store.apply(operations) == effective
    assert [value.payload for value in store.get("k").values] == ([] if shown is None else [shown])


def outcome(key: str, operations: list[Put | Delete]) -> list[StoredValue]:
    """Model: a key shows its newest put, if that is newer than every delete."""
    mine = [operation for operation in operations if operation.key == key]
    newest = max((o for o in mine if isinstance(o, Put)), key=lambda o: o.timestamp, default=None)
    if newest is None or newest.timestamp <= max((o.timestamp for o in mine if isinstance(o, Delete)), default=""):
        return []
    return [StoredValue(key, newest.payload, newest.encoding, newest.timestamp)]


@st.composite
def histories(draw: st.DrawFn) -> list[Put | Delete]:
    """Operations in order of arrival: unique timestamps in any order, some operations repeated.

    Several histories side by side, each under a first chunk of its own, for the price of one file.
    """
    operations: list[Put | Delete] = []
    for part in range(draw(st.integers(1, 8))):
        targets = draw(st.lists(st.tuples(st.booleans(), KEYS), max_size=12))
        times = draw(st.permutations(range(1, len(targets) + 1)))
        own: list[Put | Delete] = [
            put(f"{part}/{key}", time, bytes([time]), f"e{time}") if is_put else delete(f"{part}/{key}", time)
            for (is_put, key), time in zip(targets, times, strict=True)
        ]
        operations += own
        if own:
            operations += draw(st.lists(st.sampled_from(own), max_size=3))
    return operations


@settings(max_examples=40, deadline=None)
@given(histories(), st.integers(0, 60))
def test_the_outcome_is_that_of_the_model_whatever_the_order(
    tmp_path_factory: pytest.TempPathFactory, operations: list[Put | Delete], cut: int
) -> None:
    file = tmp_path_factory.mktemp("history") / "store.db"
    keys = {operation.key for operation in operations}
    wanted = {key: outcome(key, operations) for key in keys}
    with Database(file) as store:
        store.apply(operations[:cut])
    with Database(file) as store:
        store.apply(operations[cut:])
        assert {key: store.get(key).values for key in keys} == wanted
        numbers = store.statistics()
    assert numbers["entries"] == sum(len(values) for values in wanted.values())
    assert numbers["payload_bytes"] == numbers["entries"]


def test_a_batch_is_applied_as_a_whole_or_not_at_all(store: Database) -> None:
    store.apply([put("a", 1, b"before")])
    unstorable = put("b", 2, encoding="\ud800")
    with pytest.raises(UnicodeEncodeError):
        store.apply([put("a", 2, b"after"), unstorable])
    assert [value.payload for value in store.get("**").values] == [b"before"]
    assert store.apply([put("a", 2, b"after")]) == 1


def test_only_so_many_deletes_are_remembered(store: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(database, "DELETES_REMEMBERED", 10)
    for time in range(100, 130):
        store.apply([delete(f"k/{time}", time)])
    assert store.statistics()["deletes_remembered"] == 10
    late = [put("k/120", 1), put("k/119", 1)]
    assert [store.apply([operation]) for operation in late] == [0, 1]


# -- pruning and size


def test_pruned_keys_are_gone_and_welcome_again(store: Database) -> None:
    store.apply([put("a", 5), put("b", 5), put("c", 5)])
    assert store.prune(["a", "c", "unknown"]) == 2
    assert [stored.key for stored in store.keys("**")] == ["b"]
    assert store.apply([put("a", 4)]) == 1


def test_pruning_gives_the_space_back(file: Path) -> None:
    with Database(file) as store:
        store.apply([put(f"k/{n}", 1, bytes(3000)) for n in range(2000)])
    full = file.stat().st_size
    with Database(file) as store:
        assert store.prune([stored.key for stored in store.keys("**")]) == 2000
    assert full > 6_000_000
    assert file.stat().st_size < 100_000


def test_the_file_stays_bounded_under_steady_churn(file: Path) -> None:
    sizes = []
    with Database(file) as store:
        for time in range(1, 3001, 20):
            store.apply([put(f"k/{n:08}", n, bytes(3000)) for n in range(time, time + 20)])
            store.prune([stored.key for stored in store.keys("k/*")][:-100])
            sizes.append(store.statistics()["file_bytes"])
    # 100 values of 3 kB, a batch, and the log, of which SQLite writes 4 MB before it starts again.
    assert max(sizes) < 6_000_000
    assert file.stat().st_size < 600_000


def fill(store: Database) -> int:
    """Put 10 kB values, two to a batch, until the store is full; return how many it took."""
    count = 0
    with pytest.raises(StoreFullError, match=r"store\.db: expected room"):
        while count < 1000:
            store.apply([put(f"k/{n:04}", 5, bytes([n % 256]) * 10_000) for n in (count, count + 1)])
            count += 2
    return count


def test_a_full_store_keeps_what_it_has_and_works_again_when_there_is_room(file: Path) -> None:
    with Database(file, max_bytes=MEGABYTE) as store:
        count = fill(store)
        assert 40 < count < 100
        assert [value.payload[0] for value in store.get("k/*").values] == list(range(count))
        with pytest.raises(StoreFullError):
            store.apply([delete("k/0000", 9), put("big", 9, bytes(MEGABYTE))])
        assert len(store.get("k/0000").values) == 1
        assert store.apply([delete(f"k/{n:04}", 9) for n in range(10)]) == 10
        assert store.prune([f"k/{n:04}" for n in range(10, 20)]) == 10
        assert store.apply([put(f"later/{n}", 9, bytes(10_000)) for n in range(15)]) == 15
        assert len(store.keys("**")) == count - 20 + 15
    assert file.stat().st_size <= MEGABYTE
    with Database(file, max_bytes=MEGABYTE) as store:
        assert len(store.keys("**")) == count - 20 + 15


def test_a_limit_that_is_too_small_is_refused(file: Path) -> None:
    with pytest.raises(ValueError, match="max_bytes: expected at least 1048576, got 1000"):
        Database(file, max_bytes=1000)
    assert not file.exists()


# -- other processes


def python(program: str, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", dedent(program), *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


WRITER = """
    import sys
    from pathlib import Path
    from services.store.database import Database
    from services.store.values import Put
    store = Database(Path(sys.argv[1]))
    number = len(store.keys("k/*"))
    while True:
        batch = range(number, number + 3)
        store.apply([Put(f"k/{n:08}", n.to_bytes(4) * 700, "e", f"{n + 1:016x}/{'01' * 16}") for n in batch])
        number += 3
        print(number, flush=True)
"""


@pytest.mark.parametrize("acknowledged", [1, 7, 450])
def test_what_was_acknowledged_survives_sigkill(file: Path, acknowledged: int) -> None:
    for _ in range(2):
        writer = python(WRITER, str(file))
        assert writer.stdout is not None
        lines = [writer.stdout.readline() for _ in range(acknowledged)]
        writer.kill()
        # Not communicate(): that reads past what readline() has taken into its buffer.
        last = int([*lines, *writer.stdout.read().splitlines()][-1])
        writer.communicate()
        with Database(file) as store:
            values = store.get("k/*").values
        # A batch may have been stored whose acknowledgement was lost, never half a batch.
        assert last <= len(values) <= last + 3
        assert len(values) % 3 == 0
        assert [value.payload for value in values] == [n.to_bytes(4) * 700 for n in range(len(values))]


def test_a_second_store_on_the_file_is_refused_until_the_first_is_killed(file: Path) -> None:
    writer = python(WRITER, str(file))
    assert writer.stdout is not None
    writer.stdout.readline()
    with pytest.raises(StoreBusyError, match=r"store\.db"):
        Database(file)
    writer.stdout.readline()
    assert writer.poll() is None
    writer.kill()
    writer.communicate()
    Database(file).close()


def test_a_second_store_in_the_same_process_is_refused_and_harms_nothing(file: Path, store: Database) -> None:
    for _ in range(2):
        with pytest.raises(StoreBusyError, match=r"store\.db"):
            Database(file)
    store.apply([put("a", 1)])
    foreign = sqlite3.connect(file, timeout=0)
    with pytest.raises(sqlite3.OperationalError, match="locked"):
        foreign.execute("SELECT * FROM entry")
    foreign.close()
    store.apply([put("b", 1)])
    assert len(store.keys("**")) == 2


def test_a_file_that_another_program_uses_is_refused(file: Path) -> None:
    Database(file).close()
    foreign = sqlite3.connect(file, isolation_level=None)
    foreign.execute("BEGIN IMMEDIATE")
    with pytest.raises(StoreBusyError, match=r"store\.db"):
        Database(file)
    foreign.close()
    Database(file).close()


LIMITED = """
    import json, resource, sys
    from pathlib import Path
    from services.store.database import Database
    from services.store.sqlite_file import StoreFullError
    from services.store.values import Put
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    store = Database(Path(sys.argv[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, hard))
    def batch(start):
        return [Put(f"k/{n:08}", bytes(10_000), "e", f"{9:016x}/{'01' * 16}") for n in range(start, start + 3)]
    count = errors = 0
    while errors < 3:
        try:
            store.apply(batch(count))
            count += 3
        except StoreFullError as error:
            errors += 1
    kept = len(store.get("k/*").values)
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, hard))
    later = store.apply(batch(count))
    store.close()
    print(json.dumps({"count": count, "kept": kept, "later": later}))
"""


def test_a_disk_that_takes_no_more_loses_nothing(file: Path) -> None:
    process = python(LIMITED, str(file))
    output, errors = process.communicate()
    assert (process.returncode, errors) == (0, "")
    result = json.loads(output)
    assert result["count"] > 30
    assert (result["kept"], result["later"]) == (result["count"], 3)
    with Database(file) as store:
        assert len(store.keys("k/*")) == result["count"] + 3


# -- files that are not to be opened


def foreign_file(file: Path, *pragmas: str) -> None:
    connection = sqlite3.connect(file)
    connection.execute("CREATE TABLE something (x)")
    for pragma in pragmas:
        connection.execute(f"PRAGMA {pragma}").fetchall()
    connection.close()


def refused(file: Path, message: str) -> None:
    before = file.read_bytes()
    with pytest.raises(StoreFileError, match=message):
        Database(file)
    assert file.read_bytes() == before
    assert not file.with_name(file.name + "-wal").exists()


def test_a_file_that_is_no_database_is_refused_and_unchanged(file: Path) -> None:
    file.write_text("notes, not a database\n" * 100)
    refused(file, r"store\.db: .* not an SQLite database")
    file.write_text("short")
    refused(file, "not an SQLite database")


def test_a_database_of_something_else_is_refused_and_unchanged(file: Path) -> None:
    foreign_file(file, "journal_mode = WAL")
    refused(file, r"store\.db: expected application id 0x54524e4c, got 0x0")


@pytest.mark.parametrize("version", [0, 1, 3])
def test_a_store_of_another_schema_is_refused_and_unchanged(file: Path, version: int) -> None:
    foreign_file(file, f"application_id = {APPLICATION_ID}", f"user_version = {version}")
    refused(file, f"expected store schema version 2, got {version}")


@pytest.mark.parametrize("damage", ["cut short", "overwritten"])
def test_a_damaged_store_is_refused_and_unchanged(file: Path, damage: str) -> None:
    with Database(file) as store:
        store.apply([put(f"k/{n}", 1, bytes(3000)) for n in range(100)])
    content = bytearray(file.read_bytes())
    if damage == "cut short":
        del content[len(content) // 2 :]
    else:
        content[4096 * 3 : 4096 * 20] = b"\xa5" * (4096 * 17)
    file.write_bytes(content)
    refused(file, r"store\.db: expected.*`treenail store salvage \S*store\.db OUT` saves the rest")


@pytest.mark.parametrize("column", ["data", "encoding", "timestamp", "key"])
def test_a_value_that_is_not_what_was_put_is_told_and_not_given_back(file: Path, column: str) -> None:
    with Database(file) as store:
        store.apply([put(name, 1, b"abcdefgh", "text/plain") for name in "klm"])
    table, place = ("payload", "id = 2") if column == "data" else ("entry", "key = 'l'")
    changes = {"data": "x'6162636465666769'", "encoding": "'text/plaim'", "timestamp": f"'{at(2)}'", "key": "'j'"}
    with closing(sqlite3.connect(file)) as connection:
        connection.execute(f"UPDATE {table} SET {column} = {changes[column]} WHERE {place}")
        connection.commit()
    with Database(file) as store:
        reading = store.get("**")
        assert [value.key for value in reading.values] == ["k", "m"]
        assert reading.damaged == store.damaged() == ["j" if column == "key" else "l"]


def test_a_key_can_take_over_what_another_one_holds(store: Database) -> None:
    store.apply([put("a", 5, b"5"), put("b", 7, b"7")])
    store.copy("a", "b")
    store.copy("a", "c")
    assert [(value.key, value.payload, value.timestamp) for value in store.get("*").values] == [
        (key, b"5", at(5)) for key in "abc"
    ]
    assert store.damaged() == []


@pytest.mark.parametrize("how", ["deleted", "moved", "replaced"])
def test_a_file_that_is_gone_is_noticed_and_its_content_can_be_saved(file: Path, store: Database, how: str) -> None:
    store.apply([put("a", 1, b"payload")])
    assert not store.missing()
    if how == "deleted":
        file.unlink()
    else:
        file.rename(file.with_name("elsewhere"))
    if how == "replaced":
        file.write_bytes(b"")
    assert store.missing()
    rescued = file.with_name("rescued.db")
    store.rescue(rescued)
    with Database(rescued) as again:
        assert [value.payload for value in again.get("**").values] == [b"payload"]


def test_an_empty_file_becomes_a_store(file: Path) -> None:
    file.touch()
    with Database(file) as store:
        assert store.apply([put("a", 1)]) == 1


def test_closing_twice_is_allowed(file: Path) -> None:
    store = Database(file)
    store.close()
    store.close()
    Database(file).close()
