"""Whole cells that begin with a learnt skill, or are given one, end as the run in one process that begins with it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from services.rules import skill as skills
from services.wire.definition_file import load, run_id

EPISODES = 60
"""Long enough for a run to be still under way when a command has come up and asked."""
PATIENCE_S = 120.0

Digests = dict[str, str]


@pytest.fixture(scope="module")
def file(small: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What seed 5 learns in six episodes."""
    from experiments.lab.in_process import InProcessRun

    run = InProcessRun(load(str(small)), 5)
    list(run.episodes(6))
    path = tmp_path_factory.mktemp("skill") / "learnt.skill"
    skills.write(path, run.learnt())
    return path


@pytest.fixture(scope="module")
def expected(small: Path, file: Path, tmp_path_factory: pytest.TempPathFactory) -> Digests:
    """How ``treenail experiment run --skill`` ends."""
    out = tmp_path_factory.mktemp("expected")
    words = ["run", str(small), "--skill", str(file), "--episodes", str(EPISODES), "--seed-list", "1"]
    command = [sys.executable, "-m", "treenail.commands.experiment", *words, "--out", str(out)]
    subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE_S)
    (done,) = json.loads((out / "summary.json").read_text())["runs"]
    found: Digests = done["digests"]
    return found


def test_begun_with_a_skill_a_cell_ends_as_the_run_in_one_process(
    up: Callable[..., Any],
    file: Path,
    small: Path,
    expected: Digests,
    reference: Callable[..., Digests],
    digests_in: Callable[[Path], Digests],
    endpoint_of: Callable[[Path], str],
    kill_after: Callable[..., None],
    tmp_path: Path,
) -> None:
    out = tmp_path / "A"
    process = up(out, EPISODES, "--skill", str(file))
    endpoint = endpoint_of(out)
    for victim in ("agent", "task", "agent", "classifier"):
        kill_after(process, endpoint, victim, 9)
    assert process.end() == 0, process.err
    assert process.err == ""
    assert process.out.count("was killed by SIGKILL; starting it again") == 4
    assert digests_in(out) == expected != reference(EPISODES)
    run = run_id(load(str(small)), 1, skills.read(file).sha256)
    assert process.out.startswith(f"run {run} in {out}")


def test_stopped_and_started_again_it_is_the_same_run(
    up: Callable[..., Any],
    file: Path,
    expected: Digests,
    digests_in: Callable[[Path], Digests],
    endpoint_of: Callable[[Path], str],
    after_actions: Callable[[str, int], None],
    tmp_path: Path,
) -> None:
    out = tmp_path / "A"
    process = up(out, EPISODES, "--skill", str(file))
    after_actions(endpoint_of(out), 20)
    assert process.stop(signal.SIGINT) == 130
    (out / "logs" / "router.log").unlink()
    again = up(out, EPISODES)  # the skill is in the store
    assert again.end() == 0, again.err
    assert "the store says what to begin with: run " in again.out
    assert digests_in(out) == expected


def test_skill_given_to_a_running_cell_makes_its_run_another_one(
    up: Callable[..., Any],
    run_module: Callable[..., Any],
    file: Path,
    expected: Digests,
    digests_in: Callable[[Path], Digests],
    endpoint_of: Callable[[Path], str],
    after_actions: Callable[[str, int], None],
    tmp_path: Path,
) -> None:
    out = tmp_path / "A"
    process = up(out, EPISODES)
    endpoint = endpoint_of(out)
    after_actions(endpoint, 30)
    given = run_module("treenail.__main__", "checkpoint", "import", str(file), "--yes", "--connect", endpoint)
    assert given.end() == 0, given.err
    assert process.end() == 0, process.err
    sha256 = skills.read(file).sha256
    assert f"-k{sha256[:16]} began with skill {sha256[:12]}: " in process.out
    assert digests_in(out) == expected


@pytest.mark.parametrize("command", ["up", "experiment"])
@pytest.mark.parametrize(
    ("words", "expected_words"),
    [
        (("--skill", "none"), "none: expected a file with a skill, got none"),
        (("--skill", "text"), "text: expected a skill's file, which begins with 'treenail skill', got b'some text'"),
        (("--skill", "{file}", "--set", "moves.actions=5"), "skill: expected the actions +X,-X,+Y,-Y,+Z, got +X,-X,"),
        (("--skill", "{file}", "--set", "classifier.theta=0.1"), "skill: expected classifier.theta = 0.1, got 0.05"),
    ],
)
def test_skill_that_cannot_be_is_said_in_one_line_before_anything_starts(
    run_module: Callable[..., Any],
    small: Path,
    file: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    words: tuple[str, ...],
    expected_words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
    (tmp_path / "text").write_text("some text")
    asked = {"up": ("up", "sim", "--experiment", str(small), "--port", "0", "--no-viewer")}
    begin = asked.get(command, ("experiment", "run", str(small)))
    given = [word.format(file=file) for word in words]
    process = run_module("treenail.__main__", *begin, *given, "--out", str(tmp_path / "A"))
    assert process.end() == 2, process.out
    (line,) = process.err.splitlines()
    assert line.startswith(f"treenail {command}: ")
    assert expected_words in line
    assert not (tmp_path / "A").exists()
