"""docs/contract.md says what the code says."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from services.wire.codec import contract_sha256
from services.wire.contract import page
from services.wire.keys import CONTRACT
from services.wire.messages import MESSAGES

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
    for key, *_ in CONTRACT:
        assert f"\n| `{key}` | " in text


def test_the_hash_is_the_same_in_another_process() -> None:
    code = "from services.wire.codec import contract_sha256; print(contract_sha256())"
    found = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == contract_sha256()
