"""``treenail chaos run`` says in one line what cannot be done, and leaves nothing behind."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest


def fails(tmp_path: Path, *words: str, path: str | None = None) -> str:
    """Return the one line of a campaign that cannot begin."""
    environment = {**os.environ, "TMPDIR": str(tmp_path), "PATH": os.environ["PATH"] if path is None else path}
    command = [sys.executable, "-m", "treenail.__main__", "chaos", "run", *words]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    return line


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--kinds", "kill,flood"), "--kinds: expected some of kill, several"),
        (("--services", "robot"), "--services: expected some of router"),
        (("--kills", "0", "--kinds", "kill"), "expected something to do"),
        (("--kills", "many"), "--kills"),
        (("--episodes", "0"), "--episodes: expected a whole number from 1 to 1000000, got '0'"),
        (("--experiment", "no-such-experiment"), "no-such-experiment"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(tmp_path: Path, words: tuple[str, ...], expected: str) -> None:
    assert expected in fails(tmp_path, *words)
    assert list(tmp_path.iterdir()) == []


def test_clocks_are_skipped_in_plain_words_where_nothing_can_be_compiled(tmp_path: Path) -> None:
    line = fails(tmp_path, "--kinds", "clock,skew", path=str(tmp_path / "nothing"))
    assert line == "treenail chaos: --kinds: expected some that can be done here, got none: no C compiler (cc) here"
    assert list(tmp_path.iterdir()) == []


def test_a_folder_with_something_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "notes").write_text("mine")
    assert f"--out {tmp_path}: expected an empty or new folder" in fails(tmp_path, "--out", str(tmp_path))
    assert (tmp_path / "notes").read_text() == "mine"
