"""docs/contract.md says what the code says."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from msgspec import Struct

from services.wire.codec import contract_schema, contract_sha256
from services.wire.contract import page
from services.wire.definition import Definition
from services.wire.keys import CONTRACT
from services.wire.messages import MESSAGES, JournalStep, Swap

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "contract.md"


def test_the_page_is_up_to_date() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run `make docs`"


def test_the_page_shows_the_contract_hash() -> None:
    assert f"Contract hash: `{contract_sha256()}`." in PAGE.read_text(encoding="utf-8")


def test_every_type_field_and_key_is_on_the_page() -> None:
    text = page()
    for kind in MESSAGES:
        part = text.partition(f"\n### {kind.__name__} (version {kind.VERSION})\n")[2].partition("\n### ")[0]
        for name in kind.__struct_fields__:
            assert f"\n| `{name}` | " in part, (kind, name)
    for key in CONTRACT:
        assert f"\n| `{key}` | " in text


CODE = "from services.wire.codec import contract_sha256; print(contract_sha256())"


@pytest.mark.parametrize("flags", [[], ["-OO"]])
def test_the_hash_is_the_same_in_another_process_with_docstrings_or_without(flags: list[str]) -> None:
    found = subprocess.run([sys.executable, *flags, "-c", CODE], cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == contract_sha256()


@pytest.mark.parametrize("version", ["3.11", "3.12", "3.13", "3.14"])
def test_the_hash_is_the_same_in_other_interpreters(version: str) -> None:
    """An interpreter of another version counts if it has the two packages that the contract stands on."""
    python = shutil.which(f"python{version}")
    needed = "import sys, msgspec, numpy; assert '%d.%d' % sys.version_info[:2] == sys.argv[1]"
    if python is None or subprocess.run([python, "-c", needed, version], capture_output=True, check=False).returncode:
        pytest.skip(f"no python{version} with msgspec and numpy here")
    found = subprocess.run([python, "-c", CODE], cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == contract_sha256()


def test_what_is_written_about_a_type_is_no_part_of_the_hash(monkeypatch: pytest.MonkeyPatch) -> None:
    before = contract_schema()
    for kind in (*MESSAGES, Definition):
        monkeypatch.setattr(kind, "__doc__", "other words")
    assert contract_schema() == before


def test_every_name_range_and_version_is_a_part_of_the_hash() -> None:
    schema: Any = contract_schema()
    assert schema["versions"] == {kind.__name__: kind.VERSION for kind in MESSAGES}
    kinds: tuple[type[Struct], ...] = (*MESSAGES, Definition, JournalStep, Swap)
    for kind in kinds:
        assert list(schema["types"][kind.__name__]["fields"]) == list(kind.__struct_fields__)
    move = schema["types"]["Move"]["fields"]
    assert move["dx_mm"][0] == ["float", {"ge": -1e4, "le": 1e4}]
    assert schema["types"]["Action"]["fields"]["action"][0] == ["int", {"ge": 0, "le": 63}]
