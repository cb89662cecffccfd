"""Recordings: what was recorded once stays, however often the recorder starts."""

from __future__ import annotations

import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from rerun.chunk import RrdReader

from services.viewer.recording import new_piece
from services.viewer.stream import Stream
from services.wire.errors import CellError

SMALL = "1MB"


def test_each_start_goes_on_in_a_new_piece(tmp_path: Path) -> None:
    wished = tmp_path / "a.run.rrd"
    kept: dict[Path, bytes] = {}
    for name in ("a.run.rrd", "a.run.1.rrd", "a.run.2.rrd"):
        stream = Stream("127.0.0.1", 0, SMALL, wished)
        assert stream.recording == tmp_path / name
        stream.close()
        assert all(path.read_bytes() == content for path, content in kept.items()), "earlier ones are as they were"
        kept[stream.recording] = stream.recording.read_bytes()
        with warnings.catch_warnings(action="ignore"):  # it has no footer, and Rerun says so
            assert RrdReader(stream.recording).stream().to_chunks()


def test_two_that_start_at_once_get_two(tmp_path: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        pieces = list(pool.map(lambda _: new_piece(tmp_path / "run"), range(40)))
    assert len(set(pieces)) == 40
    assert {path.name for path in pieces} == {"run", *(f"run.{number}" for number in range(1, 40))}


@pytest.mark.parametrize("place", ["missing/run.rrd", "file/run.rrd", "run\0.rrd", "x" * 300])
def test_where_nothing_can_be_written_it_is_said(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(CellError, match=r"^viewer: --save .*cannot be written: "):
        new_piece(tmp_path / place)
