"""Wall clocks that jump, without being root: services run with a small library in front of libc's clock functions."""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

from experiments.chaos.plan import SERVICES
from services.rules.command_line import python
from services.wire.errors import TreenailError

SOURCE = Path(__file__).with_name("clock.c")
FOLDER = "TREENAIL_CLOCKS"
"""Environment variable with the folder that the library looks in."""
ALL = "all"
PROBE_JUMP_S = 86_400.0
PROBE_WITHIN_S = 30.0
PROBE = """
import json, threading, time, zenoh
lock = threading.Lock()
lock.acquire()
lock.acquire(timeout=0.05)
off = {"enabled": False}
settings = {"mode": "peer", "listen": {"endpoints": []}, "scouting": {"multicast": off, "gossip": off}}
with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
    print(time.time(), session.new_timestamp().get_time().timestamp())
"""
"""Waits for a moment, and prints what Python and Zenoh think what time it is [s]."""


class NoClocksError(TreenailError):
    """Wall clocks cannot be moved here; the message says why."""


class Clocks:
    """The offset of every service's wall clock."""

    def __init__(self, folder: Path) -> None:
        """Compile the library into ``folder``, which has to exist. Raises NoClocksError where that cannot be done."""
        self._folder = folder
        self._library = folder / "clock.so"
        compiler = shutil.which("cc")
        if compiler is None or sys.platform != "linux":
            raise NoClocksError("no C compiler (cc) here" if compiler is None else "only on Linux")
        command = [compiler, "-O2", "-shared", "-fPIC", "-o", str(self._library), str(SOURCE), "-ldl"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise NoClocksError(f"the C compiler fails: {' '.join(done.stderr.split())[:100]}")
        self.set_right()
        self._probe()

    @property
    def environment(self) -> Mapping[str, str]:
        """What a process needs in its environment for its clock to be moved."""
        others = os.environ.get("LD_PRELOAD")
        return {"LD_PRELOAD": f"{self._library}:{others}" if others else str(self._library), FOLDER: str(self._folder)}

    def set(self, name: str, offset_s: float) -> None:
        """Set how far a service's clock is ahead [s], or everybody's with ``ALL``; the two add up. Acts at once."""
        # Processes have the file mapped, so it is written in place, and 8 bytes at once.
        file = os.open(self._folder / name, os.O_WRONLY | os.O_CREAT, 0o644)
        try:
            os.pwrite(file, struct.pack("=q", round(offset_s * 1e9)), 0)
        finally:
            os.close(file)

    def set_right(self) -> None:
        """Set all clocks right."""
        for name in (ALL, *SERVICES):
            self.set(name, 0.0)

    def _probe(self) -> None:
        """Raise NoClocksError when Python or Zenoh here does not see a jump, or waits by the clock that jumps."""
        self.set(ALL, PROBE_JUMP_S)
        command, environment = python("-c", PROBE), {**os.environ, **self.environment}
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, check=False, env=environment, timeout=PROBE_WITHIN_S
            )
        except subprocess.TimeoutExpired:
            raise NoClocksError("this Python waits by the wall clock") from None
        finally:
            self.set(ALL, 0.0)
        words = done.stdout.split()
        if done.returncode != 0 or len(words) != 2:
            raise NoClocksError(f"a program with another clock does not start: {done.stderr.strip()[-100:]}")
        for name, word in zip(("Python", "Zenoh"), words, strict=True):
            if float(word) - time.time() < PROBE_JUMP_S / 2:
                raise NoClocksError(f"this build of {name} does not ask libc for the time")
