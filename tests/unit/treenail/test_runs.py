"""``treenail runs``: what is listed, what is removed, and what never is."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path

import pytest

from services.wire.errors import TreenailError
from treenail.commands import runs

DAY_S = 86_400


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two runs, one of them finished long ago, and something that is none."""
    done, begun, notes = (tmp_path / "runs" / name for name in ("done", "deep/begun", "notes"))
    for path in (done, begun / "logs", notes):
        path.mkdir(parents=True)
    summary = {"experiment": "initial", "runs": [{"seed": 3, "episodes": 20}, {"seed": 4, "episodes": 20}]}
    (done / "summary.json").write_text(json.dumps(summary))
    (done / "definition.toml").write_text("name = 'initial'\n")
    (done / "store.sqlite").write_bytes(bytes(5000))
    (begun / "store.sqlite").write_bytes(bytes(1_500_000))
    (begun / "logs" / "task.log").write_text("x" * 1000)
    (notes / "readme").write_text("mine")
    for path in (*done.iterdir(), done):
        os.utime(path, (1_000_000_000, 1_000_000_000))
    return tmp_path / "runs"


def do(*words: str) -> None:
    parser = argparse.ArgumentParser()
    runs.add_arguments(parser)
    runs.act(parser.parse_args(words))


def test_runs_are_listed_with_their_sizes(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    do("list", "--folder", str(folder), "--json")
    begun, done = json.loads(capsys.readouterr().out)
    assert (begun["bytes"], begun["finished"]) == (1_501_000, False)
    assert (done["seeds"], done["episodes"], done["finished"]) == ("3,4", "20", True)
    monkeypatch.chdir(folder.parent)
    do("list")
    said = capsys.readouterr().out
    assert all(len(line) <= 80 for line in said.splitlines())
    assert "runs/deep/begun" in said and "1.5 MB" in said and "unfinished" in said and "notes" not in said


def test_nothing_goes_without_yes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    do("clean", "--folder", str(folder))
    said = capsys.readouterr().out
    assert said.count("would remove") == 2 and said.endswith("2 runs, 1.5 MB; with --yes they go\n")
    assert sorted(path.name for path in folder.iterdir()) == ["deep", "done", "notes"]


@pytest.mark.parametrize(
    ("words", "gone", "stays"),
    [
        (("--older", "30"), "done", "deep/begun"),
        (("--unfinished",), "deep/begun", "done"),
    ],
)
def test_only_what_was_meant_goes(folder: Path, words: tuple[str, ...], gone: str, stays: str) -> None:
    do("clean", "--folder", str(folder), "--yes", *words)
    assert not (folder / gone).exists() and (folder / stays).exists() and (folder / "notes" / "readme").exists()


def test_what_is_no_run_or_in_use_stays(folder: Path) -> None:
    for path in (folder / "notes", folder / "nothing", folder):
        with pytest.raises(TreenailError, match=r"expected the folder of a run, .* nothing is gone"):
            do("clean", str(folder / "done"), str(path), "--yes")
    in_use = f"expected nobody to use it, process {os.getpid()} does"
    with (folder / "done" / "store.sqlite").open("rb"), pytest.raises(TreenailError, match=in_use):
        do("clean", str(folder / "done"), "--yes")
    assert (folder / "done").exists()
    with pytest.raises(TreenailError, match="expected a folder with runs, got none"):
        do("list", "--folder", str(folder / "nothing"))


def test_a_folder_without_runs_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    do("list", "--folder", str(tmp_path))
    assert capsys.readouterr().out == f"{tmp_path}: no runs\n"


@pytest.mark.parametrize(("count", "words"), [(0, "0 B"), (999, "999 B"), (1000, "1.0 kB"), (2_500_000, "2.5 MB")])
def test_sizes_in_words(count: int, words: str) -> None:
    assert runs.size(count) == words
