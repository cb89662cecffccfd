"""The report's cache: what was computed comes back, what is damaged is computed again, nothing else is touched."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from experiments.lab.pool import PieceError
from experiments.lab.progress import Reach
from experiments.reproduce.cache import Cache, CacheError
from experiments.reproduce.code import code_sha256
from experiments.reproduce.context import Context


@dataclass(frozen=True)
class Key:
    number: int
    version: int = 1


class Heard:
    """A reporter that remembers."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.work: list[tuple[str, int, int]] = []

    def say(self, line: str) -> None:
        self.lines.append(line)

    def begin(self, what: str, total: int, unit: str, done: int = 0) -> Reach:
        self.work.append((what, total, done))
        return lambda count: None


def context(folder: Path, heard: Heard, jobs: int = 2) -> Context:
    return Context(False, (0, 1), None, Cache(folder, heard.say), heard, jobs)


WORK = """
import os
from pathlib import Path

def squared(key):
    Path(key["folder"], f"{key['number']}.{os.getpid()}").touch()
    if key["number"] == 7:
        raise ValueError("no sevens")
    if key["number"] == 8:
        os._exit(3)
    return [key["number"], key["number"] ** 2]
"""
"""Leaves a trace of each time it is done, and fails or dies for some numbers."""


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make the work importable in other processes too; return the folder of its traces."""
    name = "squares_of_the_report"
    (tmp_path / f"{name}.py").write_text(WORK)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, name, raising=False)
    traces = tmp_path / "work"
    traces.mkdir()
    return traces


def squares(made: Context, work: Path, *numbers: int) -> list[list[int]]:
    module = importlib.import_module("squares_of_the_report")
    keys = [{"number": number, "folder": str(work), "version": 1} for number in numbers]
    return made.pieces("squares", keys, module.squared, list[int])


def traces(folder: Path) -> list[int]:
    return sorted(int(path.name.partition(".")[0]) for path in folder.iterdir())


def test_pieces_come_in_order_and_are_done_once(work: Path) -> None:
    heard = Heard()
    first = squares(context(work.parent / "cache", heard), work, 3, 1, 2)
    again = squares(context(work.parent / "cache", heard, jobs=1), work, 3, 1, 2, 4)
    assert first == [[3, 9], [1, 1], [2, 4]]
    assert again == [*first, [4, 16]]
    assert traces(work) == [1, 2, 3, 4]
    assert heard.work == [("squares", 3, 0), ("squares", 4, 3)]
    assert heard.lines == []


@pytest.mark.parametrize(
    ("number", "message"),
    [(7, r"ValueError: no sevens \(.*squares_of_the_report.py:8 in squared\)"), (8, "exit status 3")],
)
def test_a_piece_that_fails_is_named_and_those_before_it_are_kept(work: Path, number: int, message: str) -> None:
    made = context(work.parent / "cache", Heard(), jobs=1)
    with pytest.raises(PieceError, match=rf"'number': {number}.*{message}"):
        squares(made, work, 1, number, 2)
    assert squares(made, work, 1) == [[1, 1]]
    assert {1, number} <= set(traces(work)) <= {1, number, 2}, "the next one may have begun"
    assert traces(work).count(1) == 1


def test_another_version_kind_or_number_is_computed_anew(tmp_path: Path) -> None:
    cached = context(tmp_path, Heard()).cached
    assert cached("a", Key(1), lambda: 10, int) == 10
    assert cached("a", Key(1), lambda: 20, int) == 10
    assert cached("a", Key(1, version=2), lambda: 30, int) == 30
    assert cached("a", Key(2), lambda: 40, int) == 40
    assert cached("b", Key(1), lambda: 50, int) == 50
    assert len(list(tmp_path.iterdir())) == 4


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda content: b"",
    "cut": lambda content: content[:-9],
    "no JSON": lambda content: b"\xff\x00",
    "another shape": lambda content: b'{"value": 10}',
    "a digit": lambda content: content.replace(b'"value":10', b'"value":11'),
    "another key": lambda content: content.replace(b'"number":1', b'"number":2'),
    "another format": lambda content: content.replace(b'"format":2', b'"format":3'),
    "other code": lambda content: content.replace(b'"code":""', b'"code":"0f0f"'),
    "another type": lambda content: content.replace(b'"value":10', b'"value":"ten"'),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_an_entry_of_no_use_is_set_aside_with_a_word_and_computed_again(tmp_path: Path, damage: str) -> None:
    heard = Heard()
    made = context(tmp_path, heard)
    made.cached("a", Key(1), lambda: 10, int)
    path = made.cache.path("a", Key(1))
    sound = path.read_bytes()
    unusable = DAMAGES[damage](sound)
    path.write_bytes(unusable)
    assert path.read_bytes() != sound
    assert made.cached("a", Key(1), lambda: 10, int) == 10
    assert len(heard.lines) == 1
    assert "computing it again" in heard.lines[0]
    assert path.read_bytes() == sound
    aside = path.with_name(path.name + ".old")
    assert aside.read_bytes() == unusable
    assert set(tmp_path.iterdir()) == {path, aside}


def test_what_other_code_computed_is_not_used(tmp_path: Path) -> None:
    heard = Heard()
    Cache(tmp_path, heard.say, "0" * 64).keep("a", Key(1), 10, int)
    assert Cache(tmp_path, heard.say, "0" * 64).load("a", Key(1), int) == 10
    assert Cache(tmp_path, heard.say, "1" * 64).load("a", Key(1), int) is None
    assert "computed by other code (000000000000, this is 111111111111)" in heard.lines[0]


def test_the_code_is_named_by_its_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert code_sha256() == code_sha256()
    assert len(code_sha256()) == 64
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "some_learner").mkdir()
    (tmp_path / "some_learner" / "__init__.py").touch()
    module = tmp_path / "some_learner" / "policy.py"
    digests = set()
    for content in ("x = 1", "x = 2"):
        module.write_text(content)
        code_sha256.cache_clear()
        digests.add(code_sha256(("some_learner",)))
    assert len(digests) == 2


def test_a_folder_in_the_way_of_an_entry_is_left_alone(tmp_path: Path) -> None:
    heard = Heard()
    made = context(tmp_path, heard)
    path = made.cache.path("a", Key(1))
    path.mkdir()
    (path / "theirs").write_text("mine")
    assert made.cached("a", Key(1), lambda: 10, int) == 10
    assert (path / "theirs").read_text() == "mine"
    assert [line.partition(": ")[2][:9] for line in heard.lines] == ["cannot be", "cannot be"]
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("key", [{"number": 1}, {"version": "1"}, {"version": True}, [1], 1, object()])
def test_a_key_without_version_is_refused(tmp_path: Path, key: object) -> None:
    with pytest.raises(CacheError, match="key of a"):
        context(tmp_path, Heard()).cached("a", key, lambda: 10, int)


def test_a_result_that_would_not_come_back_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CacheError, match="result of a"):
        context(tmp_path, Heard()).cached("a", Key(1), lambda: float("nan"), float)
    assert list(tmp_path.iterdir()) == []
