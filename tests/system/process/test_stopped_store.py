"""A stopped cell's store is asked without a change to its run directory, which may be one that cannot be written to."""

from __future__ import annotations

from pathlib import Path

import pytest

from services.cell.local import stopped_store
from services.store.database import Database
from services.wire.errors import CellError


def test_asking_leaves_the_run_directory_as_it_was(tmp_path: Path) -> None:
    with Database(tmp_path / "store.sqlite"):
        pass
    (tmp_path / "store.sqlite.lock").unlink()  # as in an archive

    def content() -> dict[str, bytes]:
        return {file.name: file.read_bytes() for file in tmp_path.iterdir()}

    before = content()
    with stopped_store(tmp_path, "a") as client:
        assert "store" in client.alive()
        assert content() == before
    assert content() == before

    file = tmp_path / "other.sqlite"
    file.write_bytes(b"no such thing" * 100)
    with pytest.raises(CellError, match=f"{file}: expected a store's file"), stopped_store(file, "a"):
        pass
    assert content() == {**before, file.name: file.read_bytes()}
