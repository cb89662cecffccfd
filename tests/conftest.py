"""What integration and process tests share: a small experiment, its result without a bus, and tidy processes."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import pytest
from hypothesis import settings

PATIENCE_S = 60.0
"""How long anything may take on a loaded machine before a test fails."""

SMALL = """
name = "small"
[start]
x_mm = 1.0
y_mm = -1.4
height_mm = 0.2
rx_deg = 1.0
ry_deg = 0.4
[moves]
lateral_mm = 0.4
insertion_mm = 0.4
rotation_deg = 0.4
[limits]
hard_force_n = 26.0
success_fraction = 0.25
move_limit = 30
[classifier]
kind = "art2"
rho = 0.995
"""
"""Some 20 decisions an episode, as many contact states after 10 of them, and every other outcome; 0.1 s an episode."""


if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell starts what it puts into the background so, and what we start would not hear Ctrl-C either.
    signal.signal(signal.SIGINT, signal.default_int_handler)


class WaitUntil(Protocol):
    """Waits for a condition."""

    def __call__(self, what: str, holds: Callable[[], object], patience_s: float = PATIENCE_S) -> None:
        """Return when ``holds()`` is true; fail the test when it does not come true in good time."""


@pytest.fixture(scope="session")
def wait_until() -> WaitUntil:
    def wait(what: str, holds: Callable[[], object], patience_s: float = PATIENCE_S) -> None:
        deadline, pause = time.monotonic() + patience_s, threading.Event()
        while not holds():
            assert time.monotonic() < deadline, f"never happened: {what}"
            pause.wait(0.01)

    return wait


@pytest.fixture
def short_path() -> Iterator[Path]:
    """A folder whose path is short enough for sockets: they may have 107 characters."""
    folder = Path(tempfile.mkdtemp(prefix="treenail"))
    yield folder
    shutil.rmtree(folder)


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Definition file of the experiment that takes a few seconds."""
    path = tmp_path_factory.mktemp("definition") / "small.toml"
    path.write_text(SMALL)
    return path


class Reference(Protocol):
    """Gives the digests of a run without a bus."""

    def __call__(self, episodes: int, seed: int = 1, *overrides: str, experiment: str | None = None) -> dict[str, str]:
        """Return the digests of an experiment, the small one if none is named, run in one process."""


@pytest.fixture(scope="session")
def reference(small: Path, tmp_path_factory: pytest.TempPathFactory) -> Reference:
    known: dict[object, dict[str, str]] = {}

    def run(episodes: int, seed: int = 1, *overrides: str, experiment: str | None = None) -> dict[str, str]:
        key = (episodes, seed, overrides, experiment)
        if key not in known:
            out = tmp_path_factory.mktemp("reference")
            words = [word for item in overrides for word in ("--set", item)]
            length = ["--episodes", str(episodes), "--seed-list", str(seed)]
            command = [
                sys.executable,
                "-m",
                "treenail.commands.experiment",
                "run",
                experiment or str(small),
                *words,
                *length,
                "--out",
                str(out),
            ]
            subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE_S)
            (done,) = json.loads((out / "summary.json").read_text())["runs"]
            assert done["states"] > 3, "an experiment that decides nothing proves nothing"
            known[key] = done["digests"]
        return known[key]

    return run


def digests(folder: Path) -> dict[str, str]:
    """Return what ``summary.json`` says was learnt in its one run."""
    (run,) = json.loads((folder / "summary.json").read_text())["runs"]
    found: dict[str, str] = run["digests"]
    return found


@pytest.fixture(scope="session")
def digests_in() -> Callable[[Path], dict[str, str]]:
    return digests


@dataclass
class Process:
    """A process under test, with its output in files so that no pipe can fill up."""

    popen: subprocess.Popen[bytes]
    folder: Path

    @property
    def out(self) -> str:
        """Return what it has printed so far."""
        return (self.folder / "out").read_text()

    @property
    def err(self) -> str:
        """Return what it has complained about so far."""
        return (self.folder / "err").read_text()

    def end(self, timeout_s: float = PATIENCE_S) -> int:
        """Wait for its end and return its exit status."""
        return self.popen.wait(timeout_s)

    def stop(self, number: signal.Signals = signal.SIGTERM, timeout_s: float = PATIENCE_S) -> int:
        """Send a signal, wait for the end and return the exit status."""
        self.popen.send_signal(number)
        return self.end(timeout_s)

    def children(self) -> dict[str, int]:
        """Return the services that ``treenail up`` has running, as process ids by name."""
        return children(self.popen.pid)


def children(pid: int) -> dict[str, int]:
    """Return the services among a process's children, as process ids by name."""
    found: dict[str, int] = {}
    try:
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
            words = Path(f"/proc/{child}/cmdline").read_text().split("\0")
            found |= {word.removeprefix("services."): int(child) for word in words if word.startswith("services.")}
    except FileNotFoundError:
        return {}  # one has just died; whoever asks asks again
    return found


class Run(Protocol):
    """Starts processes that end with the test."""

    def __call__(self, *command: str) -> Process:
        """Start ``python -m`` with words."""


@pytest.fixture
def run_module(tmp_path: Path) -> Iterator[Run]:
    started: list[Process] = []

    def start(*command: str) -> Process:
        folder = tmp_path / f"process-{len(started)}"
        folder.mkdir()
        with (folder / "out").open("wb") as out, (folder / "err").open("wb") as err:
            popen = subprocess.Popen(
                [sys.executable, "-m", *command],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
                start_new_session=True,
            )
        started.append(Process(popen, folder))
        return started[-1]

    yield start
    for process in started:
        offspring = process.children().values()
        for pid in (process.popen.pid, *offspring):
            # Unless it was waited for, its number cannot belong to anybody else yet.
            if process.popen.poll() is None or pid in offspring:
                os.kill(pid, signal.SIGCONT)
                os.kill(pid, signal.SIGKILL)
        process.popen.wait()


# Tests do not time, and the same commit gives the same verdict.
settings.register_profile("treenail", deadline=None, derandomize=True, database=None)
settings.load_profile("treenail")
