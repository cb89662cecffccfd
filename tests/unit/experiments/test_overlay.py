"""``treenail compare``: what runs wrote, beside each other."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from experiments.lab import result_files
from experiments.leaderboard import overlay
from experiments.leaderboard.jobs import outcome
from treenail.commands import compare as command
from treenail.commands import experiment


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    home = tmp_path_factory.mktemp("runs")
    for name, seeds in (("x/a", "0,1"), ("y/a", "2")):
        words = ["--seed-list", seeds, "--episodes", "3", "--jobs", "1", "--out", str(home / name)]
        assert experiment.main(["run", "suite-round", *words]) == 0
    return home / "x/a", home / "y/a"


def test_runs_are_told_apart_by_the_end_of_their_path(folders: tuple[Path, Path]) -> None:
    first, second = overlay.read(folders)
    assert (first.label, second.label) == ("x/a", "y/a")
    assert sorted(first.outcomes) == [0, 1]
    assert first.experiment == "suite-round"
    assert overlay.read(folders[:1])[0].label == "a"


def test_figures_are_those_of_the_episodes(folders: tuple[Path, Path]) -> None:
    (runs,) = overlay.read(folders[:1])
    episodes = result_files.read_episodes(folders[0] / "episodes.csv").episodes
    assert runs.outcomes == {seed: outcome(of_seed) for seed, of_seed in episodes.items()}
    assert runs.figures["moves"] is None or runs.figures["moves"]["mean"] > 0
    assert runs.figures["episodes"] == 3


def test_a_picture_and_a_table_come_out(folders: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    picture = folders[0].parent / "both.png"
    assert command.main([*map(str, folders), "--out", str(picture)]) == 0
    said = capsys.readouterr().out
    assert "x/a" in said and "success" in said and f"curves in {picture}" in said
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert command.main([*map(str, folders), "--out", str(picture), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["y/a"]["figures"]["seeds"] == [2]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nowhere"], "nowhere: expected a folder that `treenail experiment run` wrote, got none"),
        (["."], "episodes.csv: cannot be read: No such file or directory"),
        ([".", "./"], "compare: expected every folder once, got one twice"),
        ([".", "--out", "x.pdf"], "--out: expected the name of a .png file, got x.pdf"),
    ],
)
def test_what_cannot_be_compared_is_one_line(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert command.main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"treenail compare: {said}"


@pytest.mark.parametrize("content", ["", '{"experiment":', "[]"])
def test_a_damaged_summary_is_not_said_to_be_missing(
    folders: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str
) -> None:
    shutil.copytree(folders[1], tmp_path / "a")
    damaged = tmp_path / "a" / result_files.SUMMARY
    damaged.write_text(content)
    assert command.main([str(tmp_path / "a")]) == 2
    assert capsys.readouterr().err.startswith(f"treenail compare: {damaged}: expected a summary of results")
