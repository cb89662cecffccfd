"""An emulated controller on an address of its own: a process, for ur_rtde does not always let other threads go on."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from services.cell.ur import arm

START = (0.1203, -0.4317, 0.2146, 2.31, -1.94, 0.17)


class Rig:
    """A controller with its panel."""

    def __init__(self, log: Path) -> None:
        self.address = arm().address
        words = ["-m", "services.robot_ur.emulator", "--listen", self.address, "--unlock-after-s", "0"]
        with log.open("wb") as out:
            self._process = subprocess.Popen([sys.executable, *words], stdout=out, stderr=subprocess.STDOUT)
        until(lambda: "panel on" in log.read_text(), "the emulator listens")
        (port,) = re.findall(r"panel on 127\.0\.0\.1:(\d+)", log.read_text())
        self._socket = socket.create_connection(("127.0.0.1", int(port)))
        self._panel = self._socket.makefile("rw")

    def press(self, line: str) -> None:
        """Do what a line for the panel says."""
        assert self.ask(line) == "done"

    def ask(self, line: str) -> str:
        """Return what the panel answers."""
        self._panel.write(f"{line}\n")
        self._panel.flush()
        return self._panel.readline().strip()

    @property
    def shown(self) -> tuple[float, ...]:
        """Robot mode, safety mode, whether a program runs (2), X, Y, Z [mm]."""
        return tuple(float(word) for word in self.ask("show").split())

    def close(self) -> None:
        """End it."""
        self._panel.close()
        self._socket.close()
        self._process.terminate()
        self._process.wait()


@pytest.fixture(scope="module")
def emulator(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    rig = Rig(tmp_path_factory.mktemp("ur") / "emulator.log")
    yield rig
    rig.close()


@pytest.fixture
def rig(emulator: Rig) -> Iterator[Rig]:
    """An emulator as new, without anybody connected."""
    emulator.press("reset")
    yield emulator
    emulator.press("pull 0")
    emulator.press("hangup")


def until(holds: Callable[[], object], what: str = "", patience_s: float = 30.0) -> None:
    """Wait until something holds."""
    deadline = time.monotonic() + patience_s
    while not holds():
        assert time.monotonic() < deadline, f"never happened: {what}"
        time.sleep(0.002)
