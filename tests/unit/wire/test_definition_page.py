"""docs/definition.md and the file to begin with say what the code says."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest
from msgspec import Struct

from services.wire.definition import Definition
from services.wire.definition_file import load, parse
from services.wire.definition_page import keys, page, tables, template
from treenail.commands import experiment

PAGE = Path(__file__).resolve().parents[3] / "docs" / "definition.md"


def test_the_page_is_up_to_date() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run `make docs`"


def test_every_key_has_a_meaning_and_a_default() -> None:
    kinds: list[type[Struct]] = [Definition, *(kind for _, kinds in tables() for kind in kinds)]
    for kind in kinds:
        for key in keys(kind):
            assert key.meaning, f"{kind.__name__}.{key.name}: a line under it says what it is"
            assert f"| `{key.name}` | {key.unit} | {key.kind} | {key.bounds} | " in page()


def test_the_file_to_begin_with_is_the_default_of_everything_with_every_key_in_it() -> None:
    text = template("My own_1")
    assert parse(text.encode(), "my.toml") == Definition(name="my-own-1")
    assert text.isascii()
    for table, (usual, *_) in tables():
        part = text.partition(f"\n[{table}]")[2].partition("\n[")[0]
        for key in keys(usual):
            assert f"\n{key.name} = " in part, f"{table}.{key.name}"


@pytest.mark.parametrize("name", ["", "---", "\u00e4", "x" * 100])
def test_any_name_of_a_file_makes_a_definition(name: str) -> None:
    parse(template(name).encode(), "x.toml")


def test_a_new_file_is_written_once_and_loads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "my.toml"
    assert experiment.main(["new", str(path)]) == 0
    assert load(str(path)) == Definition(name="my")
    assert experiment.main(["new", str(path)]) == 2
    assert capsys.readouterr().err == f"treenail experiment: {path}: expected no such file yet\n"


def test_half_a_new_file_is_not_left_in_the_way(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "my.toml"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))
    try:
        assert experiment.main(["new", str(path)]) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert capsys.readouterr().err == f"treenail experiment: {path}: cannot be written: File too large\n"
    assert not path.exists()
