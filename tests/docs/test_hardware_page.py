"""docs/hardware.md names a test for each thing that goes wrong: they are there, under these names."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NAMED = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", (ROOT / "docs" / "hardware.md").read_text(encoding="utf-8"))


@pytest.mark.parametrize(("path", "name"), NAMED)
def test_a_test_that_is_named_exists(path: str, name: str) -> None:
    assert f"def {name}(" in (ROOT / path).read_text(encoding="utf-8")


def test_every_row_names_one() -> None:
    page = (ROOT / "docs" / "hardware.md").read_text(encoding="utf-8")
    table = page.partition("| what | test |\n|---|---|\n")[2].partition("\n\n")[0].splitlines()
    assert len(table) > 10
    assert all("`tests/" in row for row in table)
