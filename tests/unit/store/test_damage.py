"""What becomes of a store of which something is damaged."""

from __future__ import annotations

from pathlib import Path

import pytest

from services.store.damage import Mending, mending, words
from services.store.database import Database
from services.store.salvage import look, report, runs, write
from services.store.service import mend
from services.store.sqlite_file import StoreFileError
from services.store.values import Put
from services.wire.errors import CellError
from services.wire.keys import Keys
from services.wire.text import spans

KEYS = Keys("a")
RUN = "0123456789abcdef-s1"
STAMP = f"{5:016x}/{'01' * 16}"
EPISODES = 30
ROOTS = 5
"""Last page that may be the root of a table."""
STORED = [
    KEYS.run_record(RUN),
    *(KEYS.journal(RUN, episode) for episode in range(EPISODES)),
    KEYS.journal_latest(RUN),
    *(KEYS.checkpoint(RUN, service, episode) for service in ("agent", "classifier") for episode in (10, 20)),
    *(KEYS.checkpoint_latest(RUN, service) for service in ("agent", "classifier")),
    KEYS.skill("0f" * 32),
    KEYS.skill("latest"),
]


def text(key: str) -> bytes:
    """Return what stands under a key: what ``latest`` says is said under a number too."""
    same = {KEYS.journal_latest(RUN): KEYS.journal(RUN, EPISODES - 1)}
    same |= {KEYS.checkpoint_latest(RUN, name): KEYS.checkpoint(RUN, name, 20) for name in ("agent", "classifier")}
    return same.get(key, key).encode() * 40


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "store.sqlite"
    with Database(path) as store:
        store.apply([Put(key, text(key), "text/plain", STAMP) for key in STORED])
    return path


def flip(file: Path, *keys: str) -> None:
    """Change one bit in the payload of each key, in the file itself."""
    content = bytearray(file.read_bytes())
    for key in keys:
        whole = text(key)
        place = content.find(whole)
        assert place > 0
        while key.endswith("latest") and content.find(whole, place + 1) > 0:
            place = content.find(whole, place + 1)  # the copy under a number was put before it
        content[place + 30] ^= 4
    file.write_bytes(content)


@pytest.mark.parametrize(
    ("key", "instead"),
    [
        (KEYS.checkpoint(RUN, "agent", 20), None),
        (KEYS.checkpoint(RUN, "agent", 10), None),
        (KEYS.checkpoint_latest(RUN, "classifier"), KEYS.checkpoint(RUN, "classifier", 20)),
        (KEYS.journal_latest(RUN), KEYS.journal(RUN, EPISODES - 1)),
        (KEYS.skill("0f" * 32), None),
    ],
)
def test_what_can_be_done_without_is_passed_over(file: Path, key: str, instead: str | None) -> None:
    flip(file, key)
    said: list[str] = []
    with Database(file) as store:
        assert store.damaged() == [key]
        mend(store, store.damaged(), said.append)
        assert store.damaged() == []
        assert [value.payload for value in store.get(key).values] == ([] if instead is None else [text(instead)])
        assert len(store.keys("**")) == len(STORED) - (instead is None)
    assert len(said) == 1 and key in said[0]


def test_a_newest_checkpoint_gives_way_to_the_one_before_it(file: Path) -> None:
    newest = [KEYS.checkpoint(RUN, "agent", 20), KEYS.checkpoint_latest(RUN, "agent")]
    plan = mending(STORED, newest)
    assert plan == Mending([newest[0]], [(KEYS.checkpoint(RUN, "agent", 10), newest[1])], [])
    everything = [key for key in STORED if "/agent/" in key]
    assert mending(STORED, everything) == Mending(sorted(everything), [], [])


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ([KEYS.journal(RUN, 23)], f"episode 23 of run {RUN}, of which episodes 0 to 22, 24 to 29 can still be had"),
        ([KEYS.run_record(RUN)], f"run of run {RUN}, of which episodes 0 to 29 can still be had"),
        ([KEYS.skill("latest")], "the skill that the next run begins with"),
    ],
)
def test_what_nobody_can_replace_is_named_and_the_store_does_not_go_on(file: Path, keys: list[str], said: str) -> None:
    flip(file, *keys)
    with Database(file) as store:
        assert words(STORED, keys) == said
        with pytest.raises(StoreFileError) as caught:
            mend(store, store.damaged(), pytest.fail)
        assert len(store.keys("**")) == len(STORED)
    assert f"{file}: damaged: {said}; `treenail store check {file}`" in str(caught.value)


def test_all_that_is_sound_is_salvaged_as_far_as_a_run_can_go_on(file: Path, tmp_path: Path) -> None:
    flip(file, KEYS.journal(RUN, 15), KEYS.checkpoint_latest(RUN, "agent"))
    before = file.read_bytes()
    folder = tmp_path / "copy"
    folder.mkdir()
    salvaged = look(file, folder)
    assert sorted(salvaged.damaged) == sorted([KEYS.journal(RUN, 15), KEYS.checkpoint_latest(RUN, "agent")])
    out = tmp_path / "out.sqlite"
    (left,) = write(salvaged, out)
    beyond = "episodes 16 to 29 are sound too, but there is no way to them"
    assert left.said == f"run {RUN} of cell a: goes on from episode 15 ({beyond})"
    with Database(out) as store:
        assert store.damaged() == []
        stored = {value.key: value.payload for value in store.get("**").values}
    wanted = {key: text(key) for key in STORED if "skill" in key or key == KEYS.run_record(RUN)}
    wanted |= {KEYS.journal(RUN, episode): text(KEYS.journal(RUN, episode)) for episode in range(15)}
    wanted[KEYS.journal_latest(RUN)] = text(KEYS.journal(RUN, 14))
    for name in ("agent", "classifier"):
        wanted[KEYS.checkpoint(RUN, name, 10)] = text(KEYS.checkpoint(RUN, name, 10))
        wanted[KEYS.checkpoint_latest(RUN, name)] = text(KEYS.checkpoint(RUN, name, 10))
    assert stored == wanted
    assert file.read_bytes() == before
    with pytest.raises(CellError, match="expected no such file yet"):
        write(salvaged, out)


@pytest.mark.parametrize("page", range(3, 40, 3))
def test_whatever_page_is_zeroed_the_rest_can_be_had(file: Path, tmp_path: Path, page: int) -> None:
    content = bytearray(file.read_bytes())
    if page * 4096 >= len(content):
        pytest.skip("the file has fewer pages")
    content[page * 4096 : (page + 1) * 4096] = bytes(4096)
    file.write_bytes(content)
    folder = tmp_path / "copy"
    folder.mkdir()
    try:
        salvaged = look(file, folder)
    except CellError as error:
        assert page <= ROOTS, "only without the root of all keys nothing can be had"
        assert str(error).startswith(f"{file}: expected a store's file of which something can be read, got none: ")
        return
    assert salvaged.complaint is not None or salvaged.damaged or len(salvaged.sound) == len(STORED)
    for key, value in salvaged.sound.items():
        assert value.payload == text(key)
    write(salvaged, tmp_path / "out.sqlite")
    with Database(tmp_path / "out.sqlite") as store:
        assert store.damaged() == []


def test_a_file_without_damage_is_said_to_be_sound(file: Path, tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    folder.mkdir()
    salvaged = look(file, folder)
    assert (salvaged.complaint, salvaged.damaged, len(salvaged.sound)) == (None, [], len(STORED))
    assert [run.episodes for run in runs(salvaged)] == [EPISODES]
    assert list(report(salvaged, file)) == [
        f"run {RUN} of cell a: goes on from episode {EPISODES}",
        f"{len(STORED)} values are sound, 0 are damaged",
    ]


def test_numbers_are_said_as_spans() -> None:
    assert spans([]) == ""
    assert spans([3, 1, 2, 7, 9, 8]) == "1 to 3, 7 to 9"
    assert spans([5]) == "5"
