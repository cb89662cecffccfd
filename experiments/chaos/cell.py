"""A cell to disturb: started and kept running by the code of ``treenail up sim``, one service perhaps behind a tap."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

from experiments.chaos.clocks import Clocks
from experiments.chaos.line import Faults
from services.bus.ports import free_port
from services.cell.client import Client
from services.cell.local import LocalCell
from services.cell.plan import make_plan, viewer_at
from services.cell.supervisor import Supervisor
from services.rules.command_line import module_command
from services.wire.errors import CellError

TAP_STOPS_S = 3.0


class Order(NamedTuple):
    """What a cell shall run."""

    experiment: str
    overrides: tuple[str, ...]
    swaps: tuple[str, ...]
    seed: int
    episodes: int
    out: Path
    """Folder of its own, for logs and the store's file."""
    viewer: bool


class ChaosCell:
    """A running cell. Use as a context manager; ``check`` has to be called all the time, as ``treenail up`` does."""

    def __init__(self, order: Order, far: str | None, clocks: Clocks | None) -> None:
        """``far`` is the service that stands behind the tap; None for no tap. Raises TreenailError."""
        self.plan = make_plan(
            order.experiment,
            overrides=order.overrides,
            seed=order.seed,
            episodes=order.episodes,
            swaps=order.swaps,
            out=order.out,
            viewer=viewer_at("127.0.0.1", 0, None) if order.viewer else None,
        )
        self.far = far
        self.clocks = clocks
        self.surprises: list[str] = []
        """How processes ended that nobody had killed."""
        self.tapped: dict[str, int] = {}
        """What the tap has done, once it has stopped."""
        environment: Mapping[str, str] = {} if clocks is None else clocks.environment
        self._environment = environment
        self._far_endpoint = f"tcp/127.0.0.1:{free_port()}"
        endpoints = {} if far is None else {far: self._far_endpoint}
        self._near = LocalCell(
            self.plan, self._note, environment=environment, endpoints=endpoints, also_mind=self._mind_far
        )
        self._far = Supervisor(self.plan.logs / "far", self._note, environment)
        self._tap: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> ChaosCell:
        if self.clocks is not None:
            self.clocks.set_right()
        self._near.__enter__()
        self._far.log_folder.mkdir(exist_ok=True)
        try:
            if self.far is not None:
                self._start_tap(self.far)
            self._near.start()
        except BaseException:
            self._stop()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop()

    def client(self) -> Client:
        """Return a client of the cell."""
        return self._near.client()

    def check(self) -> None:
        """Start again what has died. Raises TreenailError for a service that cannot start, and for a tap that ended."""
        self._near.mind()

    def started(self, name: str) -> float | None:
        """Return when a service's process was started (as ``time.monotonic``), or None while it has none."""
        child = self._near.supervisor.children[name]
        return child.started if name in self._near.supervisor.alive() else None

    def runs(self, name: str) -> bool:
        """Return whether a service has a process."""
        return self.started(name) is not None

    def send(self, name: str, number: signal.Signals) -> None:
        """Send a signal to a service, or to the tap by that name; to a process that has just ended it does nothing."""
        process = self._tap if name == "tap" else self._near.supervisor.children[name].process
        if process is not None:
            process.send_signal(number)

    def kill(self, name: str) -> None:
        """Kill a service at once, and see it dead."""
        process = self._near.supervisor.children[name].process
        if process is not None:
            process.kill()

    def fault(self, faults: Faults) -> None:
        """Tell the tap what to do with messages from now on."""
        assert self._tap is not None and self._tap.stdin is not None
        self._tap.stdin.write(json.dumps(asdict(faults)).encode() + b"\n")
        self._tap.stdin.flush()

    def fill_disk(self, full: bool) -> None:
        """Keep the store's process from writing a single byte to any file, or let it again."""
        process = self._near.supervisor.children["store"].process
        if process is None or process.poll() is not None:
            return
        _, hard = resource.prlimit(process.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (0 if full else hard, hard))

    # -- details -------------------------------------------------------------------------------------------------

    @property
    def _log(self) -> Path:
        return self._far.log_folder / "tap.log"

    def _mind_far(self) -> None:
        self._far.check()
        if self._tap is not None and self._tap.poll() is not None:
            raise CellError(f"tap: expected it to go on, it ended with status {self._tap.returncode}; see {self._log}")

    def _note(self, text: str) -> None:
        if "was killed by SIGKILL" not in text:
            self.surprises.append(text.partition(";")[0])

    def _start_tap(self, service: str) -> None:
        self._far.start("router", "--listen", self._far_endpoint)
        sides = ("--near", self.plan.endpoint, "--far", self._far_endpoint)
        which = ("--service", service, "--cell", self.plan.cell, "--seed", str(self.plan.seed))
        environment = {**os.environ, **self._environment, "PYTHONUNBUFFERED": "1"}
        with self._log.open("ab") as log:
            self._tap = subprocess.Popen(
                module_command("experiments.chaos.tap", *sides, *which),
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=log,
                env=environment,
                start_new_session=True,
            )

    def _stop(self) -> None:
        tap, self._tap = self._tap, None
        if tap is not None and tap.stdin is not None:
            tap.send_signal(signal.SIGCONT)
            tap.stdin.close()  # at its end the tap says what it has done, and ends
        self._near.stop()
        self._far.stop()
        if tap is not None:
            try:
                tap.wait(TAP_STOPS_S)
            except subprocess.TimeoutExpired:
                tap.kill()
                tap.wait()
            lines = [line for line in self._log.read_text(errors="replace").splitlines() if line.startswith("{")]
            self.tapped = json.loads(lines[-1]) if lines else {}
