"""Journals out of a store's file, which stays as it is, and what is said of those that are not whole."""

from __future__ import annotations

import argparse
import json
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from experiments.journal import replay_command
from experiments.journal.store_file import InFile, opened
from experiments.lab.skills import digests
from services.cell.stored import StoredRun, chosen
from services.rules.skill import read
from services.store.database import Database
from services.store.values import Put
from services.wire.definition_file import load
from services.wire.errors import CellError, GapError, NoAnswerError
from services.wire.keys import Keys
from services.wire.messages import JournalEpisode
from treenail.commands import checkpoint

KEYS = Keys("a")
EPISODES = 5


@pytest.fixture
def first(record_run: Callable[..., Any]) -> Any:
    return record_run(load("chamfered-q-softmax", ("limits.move_limit=120",)), 3, EPISODES)


@pytest.fixture
def second(record_run: Callable[..., Any], first: Any) -> Any:
    """Begins with what the first had learnt."""
    return record_run(first.record.definition, 31, 2, first.run.learnt())


@pytest.fixture
def store(first: Any, store_of: Callable[..., Path], tmp_path: Path) -> Path:
    return store_of(tmp_path / "store.sqlite", first)


def forget(path: Path, *keys: str) -> None:
    with Database(path) as database:
        for expression in keys:
            database.prune([stored.key for stored in database.keys(expression)])


def episodes_in(path: Path, run: str, until: int | None = None) -> list[JournalEpisode]:
    with opened(path) as file:
        return list(StoredRun(InFile(file, "a"), run).episodes(until))


# -- the file ---------------------------------------------------------------------------------------------------------


def test_file_and_folder_stay_as_they_are_and_may_be_read_only(store: Path, first: Any) -> None:
    before, names = store.read_bytes(), sorted(path.name for path in store.parent.iterdir())
    store.chmod(0o400)
    store.parent.chmod(0o500)
    try:
        assert episodes_in(store, first.record.run) == first.journal
    finally:
        store.parent.chmod(0o700)
    assert store.read_bytes() == before
    assert sorted(path.name for path in store.parent.iterdir()) == names


def test_what_stands_in_the_log_of_a_store_that_is_open_or_was_killed_is_there(
    store: Path, first: Any, tmp_path: Path
) -> None:
    with Database(store) as database:
        database.apply([Put(KEYS.of("journal/new-s1/run"), b"x", "text/plain", f"{1:016x}/{'1' * 32}")])
        log = store.with_name("store.sqlite-wal")
        assert log.stat().st_size > 0
        with opened(store) as file:
            assert [value.payload for value in file.values("a", "journal/new-s1/run")] == [b"x"]
            assert file.values("b", "**") == []
            assert len(file.values("a", f"journal/{first.record.run}/*/*")) == EPISODES
        killed = tmp_path / "killed" / "store.sqlite"
        killed.parent.mkdir()
        shutil.copy(store, killed)
        shutil.copy(log, killed.with_name(log.name))
    with opened(killed.parent) as file:
        assert len(file.values("a", "journal/new-s1/run")) == 1
    assert killed.with_name(log.name).exists()


@pytest.mark.parametrize("moment", ["log folded into the file", "log begun anew"])
@pytest.mark.parametrize("times", [1, 3])
def test_a_store_that_writes_between_copying_file_and_log_is_seen_at_one_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str, times: int
) -> None:
    """Two keys are always written together, and enough of them that the file is of no use without its log."""
    path, keys = tmp_path / "store.sqlite", (KEYS.of("journal/x-s1/run"), KEYS.of("journal/y-s1/run"))
    log = path.with_name("store.sqlite-wal")
    copyfile, copied, number = shutil.copyfile, [], 0

    def write() -> None:
        nonlocal number
        number += 1
        payload = number.to_bytes(8, "big") * 10_000
        database.apply([Put(key, payload, "text/plain", f"{number:016x}/{'1' * 32}") for key in keys])

    def happened() -> bytes:
        return log.read_bytes()[:32] if moment == "log begun anew" else path.read_bytes()

    def interrupted(source: Path, target: Path) -> object:
        done = copyfile(source, target)
        copied.append(source.name)
        if len(copied) % 2 and len(copied) < 2 * times:
            before = happened()
            while happened() == before:
                write()
        return done

    with Database(path) as database:
        for _ in range(30):
            write()
        monkeypatch.setattr(shutil, "copyfile", interrupted)
        with opened(path) as file:
            found = {value.payload for value in file.values("a", "journal/*/run")}
    assert found == {number.to_bytes(8, "big") * 10_000}
    assert len(copied) == (2 * times + 2 if moment == "log begun anew" else 2)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "expected a store's file, got none"),
        (b"no database, but long enough to have a header of a hundred bytes" * 3, "got one that is not an SQLite"),
    ],
)
def test_what_is_no_store_is_named_itself(tmp_path: Path, content: bytes | None, words: str) -> None:
    path = tmp_path / "some.sqlite"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(CellError, match=words) as caught, opened(path):
        pass
    assert str(caught.value).startswith(f"{path}: ")


def test_damage_is_an_error_in_one_line(store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = store.read_bytes()
    store.write_bytes(whole[: len(whole) // 2])
    assert replay_command.main(["--store", str(store)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"treenail replay: {store}: expected a")


def test_what_is_missing_in_the_file_is_said_of_the_file_itself(
    store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with sqlite3.connect(store) as database:
        database.execute("DROP TABLE payload")
    database.close()
    assert replay_command.main(["--store", str(store)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"treenail replay: {store}: expected a sound file, got no such table")
    assert f"`treenail store check {store}`" in line, "not the copy that is read"


def test_damaged_payload_is_named(store: Path, first: Any, capsys: pytest.CaptureFixture[str]) -> None:
    key = KEYS.journal(first.record.run, 2)
    with Database(store) as database:
        (value,) = database.get(key).values
        database.apply([Put(key, value.payload[:-50], value.encoding, f"{2**40:016x}/{'1' * 32}")])
    assert replay_command.main(["--store", str(store)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{store}, cell a: journal/{first.record.run}/000000/00000002: JournalEpisode: " in line


# -- the journal ------------------------------------------------------------------------------------------------------


def test_journal_comes_in_order_up_to_an_episode(store: Path, first: Any) -> None:
    run = first.record.run
    assert episodes_in(store, run) == first.journal
    for until in range(EPISODES + 1):
        assert episodes_in(store, run, until) == first.journal[:until]
    with pytest.raises(GapError, match=f"expected 6 episodes or more in the journal, got {EPISODES}"):
        episodes_in(store, run, EPISODES + 1)


@pytest.mark.parametrize("missing", range(EPISODES - 1))
def test_missing_episode_is_named(store: Path, first: Any, missing: int) -> None:
    run = first.record.run
    forget(store, KEYS.journal(run, missing))
    with pytest.raises(GapError, match=rf"^run {run}: expected episode {missing} in the journal, got "):
        episodes_in(store, run)
    assert episodes_in(store, run, missing) == first.journal[:missing]


def test_journal_of_many_blocks_with_a_block_missing(store: Path, first: Any, keep: Callable[..., None]) -> None:
    """Blocks of a hundred episodes; only their numbers matter here."""
    run = first.record.run

    def entry(episode: int) -> JournalEpisode:
        summary = replace(first.journal[0].summary, episode=episode)
        found: JournalEpisode = replace(first.journal[0], episode=episode, steps=(), summary=summary)
        return found

    keep(store, {KEYS.journal(run, episode): entry(episode) for episode in range(230)})
    keep(store, {KEYS.journal_latest(run): entry(229)})
    assert [one.episode for one in episodes_in(store, run)] == list(range(230))
    assert [one.episode for one in episodes_in(store, run, 200)] == list(range(200))
    forget(store, *(KEYS.journal(run, episode) for episode in range(100, 200)))
    with pytest.raises(GapError, match="expected episode 100 in the journal, got none; there are 230"):
        episodes_in(store, run)


def test_newest_entry_may_be_one_behind_and_no_more(store: Path, first: Any, keep: Callable[..., None]) -> None:
    run = first.record.run
    for newest in (3, 4):
        keep(store, {KEYS.journal_latest(run): first.journal[newest]})
        assert episodes_in(store, run) == first.journal
    keep(store, {KEYS.journal_latest(run): first.journal[2]})
    with pytest.raises(GapError, match="expected 3 episodes in the journal, as its newest entry says, got episode 4"):
        episodes_in(store, run)
    forget(store, KEYS.journal_latest(run))
    with pytest.raises(GapError, match="expected 0 episodes"):
        episodes_in(store, run)


def test_run_without_an_episode_is_empty(store: Path, first: Any, capsys: pytest.CaptureFixture[str]) -> None:
    run = first.record.run
    forget(store, KEYS.of(f"journal/{run}/*/*"), KEYS.journal_latest(run), KEYS.of("checkpoint/**"))
    assert replay_command.main(["--store", str(store)]) == 0
    assert "0 episodes, 0 decisions, 0 contact states" in capsys.readouterr().out


def test_skill_that_a_run_began_with_comes_from_the_store(
    second: Any, store_of: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = store_of(tmp_path / "store.sqlite", second)
    sha256 = second.began_with.sha256
    assert replay_command.main(["--store", str(path)]) == 0
    assert f"began with skill {sha256[:12]}" in capsys.readouterr().out
    forget(path, KEYS.skill(sha256))
    with opened(path) as file, pytest.raises(NoAnswerError, match=f"expected skill {sha256[:12]}, that it began with"):
        StoredRun(InFile(file, "a"), second.record.run).skill(sha256)


# -- which run --------------------------------------------------------------------------------------------------------


def test_run_is_found_by_the_beginning_of_its_name(
    first: Any, second: Any, store_of: Callable[..., Path], tmp_path: Path
) -> None:
    path = store_of(tmp_path / "store.sqlite", first, second)
    one, other = first.record.run, second.record.run
    assert other.startswith(one), "a name that begins another is the harder case"
    with opened(path) as file:
        places = [InFile(file, "a")]
        assert chosen(places, one).name == one
        assert chosen(places, other).name == chosen(places, other[:-3]).name == other
        for name, words in (
            (None, f"expected to be told which one of {one}, {other}"),
            (one[:4], f"expected the name of one run, got '{one[:4]}', which fits {one}, {other}"),
            ("zz", f"expected one of {one}, {other}, got 'zz'"),
        ):
            with pytest.raises(CellError) as caught:
                chosen(places, name)
            assert str(caught.value) == f"run: {words}"


def test_same_run_in_two_cells_of_a_file_needs_the_cell(
    first: Any, store_of: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = store_of(tmp_path / "store.sqlite", first, cell="1")
    assert replay_command.main(["--store", str(path)]) == 0
    store_of(path, first, cell="2")
    assert replay_command.main(["--store", str(path), "--cell", "2"]) == 0
    capsys.readouterr()
    assert replay_command.main(["--store", str(path)]) == 2
    run = first.record.run
    assert f"which one of {run} ({path}, cell 1), {run} ({path}, cell 2)" in capsys.readouterr().err
    assert replay_command.main(["--store", str(path), "--cell", "3"]) == 2
    assert f"{path}, cell 3: expected a run, got none" in capsys.readouterr().err


# -- what was learnt, out of a file -----------------------------------------------------------------------------------


def asked(*words: str) -> None:
    parser = argparse.ArgumentParser()
    checkpoint.add_arguments(parser)
    checkpoint.act(parser.parse_args(words))


def test_what_was_learnt_in_a_file_is_listed_and_what_is_of_another_contract_is_said(
    store: Path, first: Any, second: Any, store_of: Callable[..., Path], keep: Callable[..., None], capsys: Any
) -> None:
    store_of(store, second)
    asked("list", "--store", str(store), "--json")
    found = json.loads(capsys.readouterr().out)
    assert found["left_out"] == {}
    assert [(row["run"], row["service"], row["episodes"], row["newest"]) for row in found["runs"]] == [
        (second.record.run, "task", 2, True),
        (second.record.run, "agent", 2, True),
        (second.record.run, "classifier", 2, True),
        (first.record.run, "task", EPISODES, True),
        *((first.record.run, service, *row) for service in ("agent", "classifier") for row in ((2, False), (4, True))),
    ]
    assert [row["skill"] for row in found["skills"]] == [second.began_with.sha256]
    keep(store, {KEYS.run_record(first.record.run): replace(first.record, contract_sha256="0" * 64)})
    asked("list", "--store", str(store), "--json")
    found = json.loads(capsys.readouterr().out)
    assert {row["run"] for row in found["runs"]} == {second.record.run}
    assert list(found["left_out"]) == [first.record.run]
    asked("list", "--store", str(store))
    out = capsys.readouterr().out
    assert f"left out: run {first.record.run}: expected contract " in out
    assert "use the version of Treenail that recorded it" in out


def test_what_was_learnt_in_a_file_is_exported_as_it_was_at_any_episode(
    store: Path, first: Any, second: Any, store_of: Callable[..., Path], tmp_path: Path
) -> None:
    """Also with a journal whose first episodes are not needed any more, and beside a cell that works in the file."""
    store_of(store, second)
    forget(store, KEYS.journal(first.record.run, 0))
    with Database(store):
        for episode in (None, EPISODES, 3):
            words = () if episode is None else ("--episode", str(episode))
            file = tmp_path / f"{episode}.skill"
            asked("export", str(file), "--store", str(store), "--run", first.record.run, *words)
            made, wanted = digests(read(file).skill), first.digests[episode or EPISODES]
            assert (made["q_table"], made["art2"]) == (wanted["q_table"], wanted["art2"])
        asked("export", str(tmp_path / "second"), "--store", str(store))
        assert read(tmp_path / "second").sha256 == second.run.learnt().sha256, "the run that was worked on last"
    with pytest.raises(CellError, match=f"--episode: expected 0 to {EPISODES}, where run {first.record.run} stands"):
        asked("export", str(tmp_path / "x"), "--store", str(store), "--run", first.record.run, "--episode", "6")
    with pytest.raises(GapError, match="expected episode 0 in the journal"):
        asked("export", str(tmp_path / "x"), "--store", str(store), "--run", first.record.run, "--episode", "1")
