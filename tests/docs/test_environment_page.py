"""docs/environment.md has every variable that Treenail reads or sets, and no other."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NAME = re.compile(r"TREENAIL_[A-Z][A-Z_]*[A-Z]")
PLACES = ("services", "experiments", "treenail", "tests", "Dockerfile", "compose.yaml", "Makefile", ".ci")


def test_the_page_has_every_variable_and_no_other() -> None:
    files = [path for place in PLACES for path in (sorted((ROOT / place).rglob("*")) or [ROOT / place])]
    texts = (path.read_bytes().decode(errors="replace") for path in files if path.is_file() and path.suffix != ".pyc")
    used = {name for text in texts for name in NAME.findall(text)}
    page = (ROOT / "docs" / "environment.md").read_text()
    assert used == set(re.findall(rf"^\| `({NAME.pattern})` \|", page, re.MULTILINE))
