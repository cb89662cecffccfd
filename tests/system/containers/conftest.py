"""Cells in containers, on a real engine, from images that were built before: ``docker compose build``."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import pytest

from services.rules.results import episodes_digest
from services.wire.messages import EpisodeSummary

ROOT = Path(__file__).resolve().parents[3]
WANTED = "TREENAIL_TEST_CONTAINERS"
PROJECT = "treenail-test"
LONG_S = 120.0


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip all of this folder, plainly, where nobody has said that engine and images are there."""
    for item in items:
        if "containers" in item.path.parts:
            item.add_marker(pytest.mark.timeout(600))
            if not os.environ.get(WANTED):
                item.add_marker(
                    pytest.mark.skip(reason=f"set {WANTED}=1 where an engine runs and the images are built")
                )


def compose_command() -> list[str]:
    """Return what Compose is called here: the plugin, or the older command."""
    plugin = subprocess.run(["docker", "compose", "version"], capture_output=True, check=False).returncode == 0
    return ["docker", "compose"] if plugin or shutil.which("docker-compose") is None else ["docker-compose"]


def docker(*words: str) -> str:
    """Return what a ``docker`` command prints."""
    return subprocess.run(["docker", *words], check=True, capture_output=True, text=True, timeout=LONG_S).stdout


@dataclass
class Composition:
    """One project of compose.yaml on ports of its own."""

    wait_until: Callable[..., None]
    definitions: Path
    profile: str = "cell"
    ports: dict[str, int] = field(default_factory=dict)
    certs: Path | None = None
    """Certificates of the profile "secure"."""

    def __post_init__(self) -> None:
        for name in ("ROUTER_PORT", "RERUN_PORT", "WEB_PORT"):
            with socket.create_server(("127.0.0.1", 0)) as probe:
                self.ports[name] = int(probe.getsockname()[1])

    def __call__(self, *words: str, check: bool = True, **settings: object) -> subprocess.CompletedProcess[str]:
        """Run a Compose command with settings such as ``EPISODES=20``."""
        told: Mapping[str, object] = {
            "PUBLISH": "127.0.0.1",
            "EXPERIMENT": "/definitions/small.toml",
            "DEFINITIONS": self.definitions,
            "CERTS": self.certs or "./certs",
            **self.ports,
            **settings,
        }
        command = [*compose_command(), "-p", PROJECT, "--profile", self.profile, *words]
        environment = {**os.environ, **{name: str(value) for name, value in told.items()}}
        done = subprocess.run(
            command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=LONG_S, check=False
        )
        assert done.returncode == 0 or not check, done.stderr
        return done

    def logs(self, service: str) -> str:
        """Return what the containers of a service have printed."""
        return self("logs", "--no-color", service).stdout

    def containers(self, service: str) -> list[str]:
        """Return the containers of a service that run."""
        labels = (f"label=com.docker.compose.project={PROJECT}", f"label=com.docker.compose.service={service}")
        return docker("ps", "-q", *(word for label in labels for word in ("--filter", label))).split()

    def kill(self, service: str) -> None:
        """Kill a container's processes as a crash would; the engine knows nothing of it beforehand."""
        (container,) = self.containers(service)
        pid = int(json.loads(docker("inspect", container))[0]["State"]["Pid"])
        os.kill(pid, 9)

    def get(self, key: str, cell: str = "a") -> subprocess.CompletedProcess[str]:
        """Run ``treenail get``."""
        where = f"127.0.0.1:{self.ports['ROUTER_PORT']}"
        connect: tuple[str, ...] = ("--connect", f"tcp/{where}")
        if self.certs is not None:
            connect = ("--connect", f"tls/{where}", "--certs", str(self.certs / "guest"))
        command = [sys.executable, "-m", "treenail.__main__", "get", key, "--cell", cell, "--compact", *connect]
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=LONG_S, check=False)

    def ask(self, key: str, cell: str = "a") -> Any:
        """Return what a key answers, or None."""
        done = self.get(key, cell)
        return json.loads(done.stdout) if done.returncode == 0 else None

    def digests(self, episodes: int, cell: str = "a") -> dict[str, str]:
        """Wait for the end of a run of so many episodes; return what was learnt and logged in it."""
        found: dict[str, Any] = {}

        def done() -> bool:
            experiment = found["experiment"] = self.ask("experiment", cell)
            if experiment is None or experiment["phase"] != "finished":
                return False
            found["q"], found["art2"] = self.ask("agent/q_table", cell), self.ask("classifier/states", cell)
            learnt = [answer and answer["decisions"] for answer in (found["q"], found["art2"])]
            return learnt == [experiment["decisions"]] * 2 and found["q"]["policy_version"] == experiment["decisions"]

        self.wait_until(f"{episodes} episodes in cell {cell}", done, LONG_S)
        assert found["experiment"]["episodes_done"] == episodes
        entries = self.ask(f"journal/{found['experiment']['run']}/*/*", cell)
        summaries = [msgspec.convert(entries[key]["summary"], EpisodeSummary) for key in sorted(entries)]
        assert len(summaries) == episodes
        return {
            "q_table": found["q"]["digest"],
            "art2": found["art2"]["digest"],
            "episodes": episodes_digest(summaries),
        }


@pytest.fixture(name="docker")
def docker_fixture() -> Callable[..., str]:
    return docker


@pytest.fixture
def definitions(small: Path, tmp_path: Path) -> Path:
    """A folder with the small experiment, for users of any number to read."""
    folder = tmp_path / "definitions"
    folder.mkdir()
    shutil.copy(small, folder / "small.toml")
    folder.chmod(0o755)
    (folder / "small.toml").chmod(0o644)
    return folder


@pytest.fixture
def composition(wait_until: Callable[..., None], definitions: Path) -> Iterator[Composition]:
    """A project without anything running; afterwards nothing is left of it."""
    made = Composition(wait_until, definitions)
    made("down", "--volumes", "--remove-orphans")
    yield made
    made("down", "--volumes", "--remove-orphans")
