"""Every command that the README shows does what it says: those of a shell here, those of Docker in tests/system."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[3]
README = (ROOT / "README.md").read_text()
COMMANDS = [line for block in re.findall(r"```sh\n(.*?)```", README, re.DOTALL) for line in block.splitlines()]
SHORT = ("--episodes", "2", "--port", "0", "--viewer-port", "0")
DOCKER = {
    "docker compose up sim": "test_one_command_brings_up_a_cell_that_survives_and_resumes",
    "CELLS=4 docker compose --profile fleet up": "test_a_fleet_is_so_many_cells",
    "docker compose --profile secure up": "test_a_secured_cell_learns_the_same_and_shuts_strangers_out",
}
"""Where each of Docker's commands is run."""
CAMPAIGN = "treenail chaos run --kills 20"
"""Is run in tests/system/chaos."""
MY_OWN = 'name = "my-own"\nepisodes = 3\n'


def of(*starts: str) -> list[str]:
    """Return the README's commands with one of these beginnings."""
    return [command for command in COMMANDS if command.startswith(starts)]


def run(words: list[str], folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        words, cwd=folder, env={**os.environ, **environment}, capture_output=True, text=True, timeout=150, check=False
    )
    assert done.returncode == 0, f"{shlex.join(words)}: {done.stderr}"
    return done


def treenail(command: str, *more: str) -> list[str]:
    """Return the words of a ``treenail`` command for the interpreter that runs this test."""
    name, *words = shlex.split(command)
    assert name == "treenail"
    return [sys.executable, "-m", "treenail.__main__", *words, *more]


LONELY = of("treenail experiment", "treenail certs", "treenail up sim --certs")
JOURNALS = of("treenail replay", "treenail diff", "treenail checkpoint export kept.skill")
ASKING = of(
    "treenail status",
    "treenail top",
    "treenail q-table",
    "treenail policy",
    "treenail get",
    "treenail checkpoint",
    "treenail swap",
    "treenail up sim --skill",
)


def test_every_command_is_run_somewhere() -> None:
    known = {*LONELY, *JOURNALS, *ASKING, *DOCKER, CAMPAIGN, "make sim", "rerun rerun+http://127.0.0.1:9876/proxy"}
    assert set(COMMANDS) == known
    tests = (ROOT / "tests" / "system" / "containers" / "test_compose.py").read_text()
    assert all(f"def {name}(" in tests for name in DOCKER.values())


def test_what_needs_no_cell(tmp_path: Path) -> None:
    (tmp_path / "my-own.toml").write_text(MY_OWN)
    for command in LONELY:
        run(treenail(command, *(SHORT if " up " in command else ())), tmp_path)
    assert (tmp_path / "runs" / "mine" / "return.png").exists()
    assert (tmp_path / "certs" / "agent" / "key.pem").exists()


def test_what_needs_journals_alone(tmp_path: Path) -> None:
    for folder in ("kept", "other"):
        up = f"treenail up sim --no-viewer --seed 3 --out runs/{folder}"
        run(treenail(up, *SHORT), tmp_path)
    for command in JOURNALS:
        assert run(treenail(command), tmp_path).stdout.strip(), command


@pytest.fixture
def cell(run_module: Callable[..., Any], wait_until: Callable[..., None], tmp_path: Path) -> Iterator[Path]:
    """Log folder of a cell that has learnt something and goes on."""
    out = tmp_path / "cell"
    length = ("--episodes", "100000", "--seed", "1")
    process = run_module(
        "treenail.__main__", "up", "sim", *length, "--port", "0", "--viewer-port", "0", "--out", str(out)
    )
    wait_until("it has learnt something", lambda: "return(10)" in process.out)
    yield out / "logs"
    assert process.stop(signal.SIGINT) == 130


def test_what_asks_a_cell(cell: Path, tmp_path: Path) -> None:
    endpoint = (cell / "router.log").read_text().split("listening on ")[1].split()[0]
    for command in ASKING:
        if command in JOURNALS:
            continue
        done = run(treenail(command, *(SHORT if " up " in command else ())), tmp_path, TREENAIL_CONNECT=endpoint)
        assert done.stdout.strip(), command
    assert (tmp_path / "peg.skill").stat().st_size > 1000


def test_a_viewer_attaches(cell: Path, wait_until: Callable[..., None], tmp_path: Path) -> None:
    (command,) = of("rerun")
    (port,) = re.findall(r"rerun\+http://127.0.0.1:([0-9]+)/proxy", (cell / "viewer.log").read_text())
    words = shlex.split(command.replace("127.0.0.1:9876", f"127.0.0.1:{port}"))
    saved = tmp_path / "late.rrd"
    # Without a screen it can only record; and its own port is not to be in anybody's way.
    words = [str(Path(sys.executable).with_name(words[0])), *words[1:], "--save", str(saved), "--port", "auto"]
    viewer = subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        wait_until("it receives", lambda: saved.exists() and saved.stat().st_size > 10_000)
    finally:
        viewer.kill()
        viewer.wait()


def test_make_sim(tmp_path: Path) -> None:
    arguments = shlex.join([*SHORT, "--out", str(tmp_path / "run")])
    done = run(["make", "sim", f"ARGS={arguments}"], ROOT)
    assert "episode 2/2" in done.stdout
