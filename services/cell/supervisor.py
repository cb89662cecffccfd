"""Keeps the processes of a cell running: starts them, restarts what dies with a growing delay, stops all at once."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from services.bus.command import CERTS, DIE_WITH_PARENT, EXIT_OUSTED
from services.rules.command_line import EXIT_ERROR, module_command, service_module
from services.wire.errors import TreenailError

FIRST_DELAY_S = 0.1
LONGEST_DELAY_S = 5.0
SETTLED_S = 10.0
"""A process that lived this long starts again with the first delay."""
TRIES = 4
"""A process that has failed so often, and never lived that long, is given up."""
_LAST_BYTES = 1 << 16
"""Of a log in which its last line is looked for."""
STOP_S = 2.0
"""How long processes get between SIGTERM and SIGKILL."""


class StartError(TreenailError):
    """A service that could not start; the message is the service's own line."""


@dataclass
class Child:
    """One service's process."""

    name: str
    command: Sequence[str]
    log: Path
    process: subprocess.Popen[bytes] | None = None
    started: float = 0.0
    restarts: int = 0
    delay_s: float = FIRST_DELAY_S
    settled: bool = False
    """Whether it ever lived for long."""
    failures: int = 0
    """How often it ended by itself in an error."""
    due: float = 0.0
    """When to start it again."""
    taken: bool = False
    """Whether it was told already that somebody else has its role."""
    log_from: int = 0
    """Where in its log begins what this process says."""

    @property
    def last_words(self) -> str:
        """Return the last line that this process said, or why nobody can know it; nothing when it said nothing."""
        if line := last_line(self.log, self.log_from):
            return line
        try:
            with self.log.open("ab", buffering=0) as log:
                log.write(b"\n")
        except OSError as error:
            return f"{self.name}: what it says cannot be written to {self.log}: {error.strerror}"
        return ""


@dataclass
class Supervisor:
    """The processes of a cell."""

    log_folder: Path
    notify: Callable[[str], None]
    """Is told, in a sentence, when a process died."""
    environment: Mapping[str, str] = field(default_factory=dict)
    certs: Path | None = None
    """Folder of `treenail certs`: each process gets the certificate of its name."""
    children: dict[str, Child] = field(default_factory=dict)

    def start(self, name: str, *arguments: str) -> None:
        """Start a service's program with arguments; its output goes to ``<name>.log``."""
        certs = () if self.certs is None else ("--certs", str(self.certs / name))
        self.run(name, module_command(service_module(name), *arguments, *certs))

    def run(self, name: str, command: Sequence[str]) -> None:
        """Start any command as a service of that name."""
        child = self.children[name] = Child(name, command, self.log_folder / f"{name}.log")
        self._spawn(child)

    def check(self) -> None:
        """Restart what has died and is due. Raises StartError when a service's first start failed for good."""
        now = time.monotonic()
        for child in self.children.values():
            if child.process is None:
                if now >= child.due:
                    self._spawn(child)
                continue
            status = child.process.poll()
            if status is not None:
                self._bury(child, status, now)

    def alive(self) -> list[str]:
        """Return the names of the services whose process runs."""
        return [child.name for child in self.children.values() if child.process and child.process.poll() is None]

    def stop(self, *names: str) -> list[str]:
        """Stop processes, by default all; return the names of those that had to be killed."""
        leaving = [self.children.pop(name) for name in names or tuple(self.children)]
        running = [child for child in leaving if child.process is not None]
        for child in running:
            _send(child, signal.SIGTERM)
        deadline = time.monotonic() + STOP_S
        killed = []
        for child in running:
            assert child.process is not None
            try:
                child.process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                _send(child, signal.SIGKILL)
                child.process.wait()
                killed.append(child.name)
        return killed

    def _spawn(self, child: Child) -> None:
        # A certificate that our own environment names is ours, not theirs.
        environment = {
            **os.environ,
            CERTS: "",
            **self.environment,
            DIE_WITH_PARENT: str(os.getpid()),
            "PYTHONUNBUFFERED": "1",
        }
        with self._log(child) as log:
            child.log_from = log.tell()
            # A session of its own: Ctrl-C in the terminal reaches us alone, and we stop the services in order.
            child.process = subprocess.Popen(
                child.command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=environment, start_new_session=True
            )
        child.started = time.monotonic()

    def _log(self, child: Child) -> IO[bytes]:
        """Return where a child's output goes: its log, in a folder that is made again when it is gone."""
        try:
            child.log.parent.mkdir(parents=True, exist_ok=True)
            return child.log.open("ab")
        except OSError as error:
            self.notify(f"{child.name}: {child.log} cannot be written: {error.strerror}; what it says is lost")
            return open(os.devnull, "ab")

    def _bury(self, child: Child, status: int, now: float) -> None:
        lived = now - child.started
        if status == EXIT_OUSTED:
            self._wait_for_role(child, now)
            return
        child.settled = child.settled or lived >= SETTLED_S
        child.failures += status > 0
        hopeless = (status == EXIT_ERROR and child.restarts == 0) or child.failures >= TRIES
        if hopeless and not child.settled:
            raise StartError(child.last_words or f"{child.name}: exited with status {status}")
        child.delay_s = FIRST_DELAY_S if lived >= SETTLED_S else min(2 * child.delay_s, LONGEST_DELAY_S)
        child.process = None
        child.restarts += 1
        child.due = now + child.delay_s
        how = f"was killed by {signal.Signals(-status).name}" if status < 0 else f"exited with status {status}"
        child.taken = False
        self.notify(f"{child.name} {how}; starting it again in {child.delay_s:.1f} s (see {child.log})")

    def _wait_for_role(self, child: Child, now: float) -> None:
        """Start a child again and again until its role is free: what others do in the cell never ends it."""
        child.process = None
        child.restarts += 1
        child.delay_s = min(2 * child.delay_s, LONGEST_DELAY_S)
        child.due = now + child.delay_s
        if not child.taken:
            self.notify(f"{child.last_words or child.name}; waiting until its role is free")
        child.taken = True


def last_line(log: Path, start: int = 0) -> str:
    """Return the last line of a log that is not empty, ``start`` bytes on; nothing of a log that is not there."""
    if not log.exists():
        return ""
    with log.open("rb") as file:
        file.seek(max(start, log.stat().st_size - _LAST_BYTES))
        lines = [line for line in file.read().decode(errors="replace").splitlines() if line.strip()]
    return lines[-1] if lines else ""


def _send(child: Child, number: signal.Signals) -> None:
    if child.process is not None and child.process.poll() is None:
        child.process.send_signal(number)
