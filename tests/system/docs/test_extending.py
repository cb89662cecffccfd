"""The examples of docs/extending.md: a package that installs and learns, and a learner that proposes moves.

Both end in the same bytes over Zenoh as in one process.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "extending.md").read_text()
FILES = re.findall(r"^`([\w.]+)`\n\n```\w+\n(.*?)```", PAGE, re.DOTALL | re.MULTILINE)
SETTINGS = [word for word in re.findall(r"--set \S+", PAGE.split("treenail up sim")[1].splitlines()[0])]
PROPOSES = shlex.split(re.findall(r"is one:\n\n((?: {6}.*\n)+)", PAGE)[0].replace("\\\n", " "))
"""The command that tries a learner of moves, word for word."""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder that the example is installed into."""
    source, target = tmp_path_factory.mktemp("expected-sarsa"), tmp_path_factory.mktemp("site")
    assert [name for name, _ in FILES] == ["pyproject.toml", "expected_sarsa.py"]
    for name, content in FILES:
        (source / name).write_text(content)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "--target", str(target), str(source)], check=True, timeout=120)
    return target


def run(folder: Path, site: Path, *words: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(site)}
    command = [str(Path(sys.executable).with_name("treenail")), *words]
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=150, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_module_is_as_short_as_it_says() -> None:
    assert sum(len(content.splitlines()) for _, content in FILES) <= 42


def test_the_example_learns_and_is_one_truth(installed: Path, tmp_path: Path) -> None:
    settings = [word for setting in SETTINGS for word in setting.split()]
    assert len(settings) == 6
    run(tmp_path, installed, "experiment", "run", "chamfered-q-softmax", "--episodes", "8", "--out", "alone", *settings)
    run(tmp_path, installed, "experiment", "run", "chamfered-q-softmax", "--episodes", "8", "--out", "plain")
    ports = ("--port", "0", "--no-viewer")
    run(
        tmp_path,
        installed,
        "up",
        "sim",
        "--experiment",
        "chamfered-q-softmax",
        "--episodes",
        "8",
        "--out",
        "cell",
        *ports,
        *settings,
    )
    digests = {
        name: json.loads(next((tmp_path / name).rglob("summary.json")).read_text())["runs"][0]["digests"]
        for name in ("alone", "plain", "cell")
    }
    assert digests["alone"] == digests["cell"]
    assert digests["alone"]["q_table"] != digests["plain"]["q_table"]


def test_the_command_for_a_learner_of_moves_is_one_truth(tmp_path: Path) -> None:
    assert PROPOSES[:5] == ["treenail", "up", "sim", "--experiment", "suite-round"]
    settings = PROPOSES[5:]
    assert settings[::2] == ["--set"] * 4
    nowhere = tmp_path / "nowhere"
    run(tmp_path, nowhere, "experiment", "run", "suite-round", "--episodes", "4", "--out", "alone", *settings)
    run(tmp_path, nowhere, *PROPOSES[1:], "--episodes", "4", "--out", "cell", "--port", "0", "--no-viewer")
    alone, cell = (
        json.loads(next((tmp_path / name).rglob("summary.json")).read_text())["runs"][0]["digests"]
        for name in ("alone", "cell")
    )
    assert alone == cell
    skill = next((tmp_path / "cell").rglob("seed0.skill"))
    learnt = json.loads(run(tmp_path, nowhere, "checkpoint", "show", str(skill), "--json"))
    assert learnt["version"] > 0, "it has learnt from the moves that it made"
