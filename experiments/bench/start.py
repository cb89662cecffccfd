"""``bench start``: how long ``treenail up sim`` takes from the command to its first finished episode."""

from __future__ import annotations

import queue
import signal
import subprocess
import tempfile
import time
from pathlib import Path

from experiments.bench.cell import Subject
from experiments.bench.values import Value, spread
from services.bus.ports import free_port
from services.bus.service import Options
from services.cell.client import Client
from services.cell.supervisor import last_line
from services.rules.command_line import module_command
from services.wire.errors import CellError
from services.wire.keys import EPISODE
from services.wire.messages import EpisodeSummary

TARGET_S = 10.0
"""On two cores."""
PATIENCE_S = 120.0
STOP_S = 10.0


def measure(subject: Subject, rounds: int) -> dict[str, Value]:
    """Bring a cell up, viewer included, so many times, each in an empty folder; stop it after its first episode."""
    words = ["--experiment", subject.experiment, "--seed", str(subject.seed)]
    words += [word for item in subject.overrides for word in ("--set", item)]
    seconds = spread([_first_episode(words) for _ in range(rounds)])
    return {
        "experiment": subject.experiment,
        "seed": subject.seed,
        "rounds": rounds,
        "first_episode_s": seconds,
        "target_s": TARGET_S,
        "target_met": seconds["median"] <= TARGET_S,
    }


def _first_episode(words: list[str]) -> float:
    """Return the time [s] of one start. Raises CellError when the command ends before its first episode."""
    with tempfile.TemporaryDirectory(prefix="treenail-bench-") as name:
        said, port = Path(name, "said"), free_port()
        places = ["--out", str(Path(name, "run")), "--port", str(port), "--viewer-port", "0"]
        command = module_command("treenail.__main__", "up", "sim", *words, *places)
        with said.open("wb") as out:
            began = time.perf_counter()
            process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=out)
        try:
            return _arrival(port, process, said) - began
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _arrival(port: int, process: subprocess.Popen[bytes], said: Path) -> float:
    arrived: queue.SimpleQueue[float] = queue.SimpleQueue()

    def note(_: EpisodeSummary) -> None:
        arrived.put(time.perf_counter())

    deadline = time.monotonic() + PATIENCE_S
    with Client(Options("a", (f"tcp/127.0.0.1:{port}",), PATIENCE_S)) as client:
        client.subscribe(EPISODE, EpisodeSummary, note)
        while time.monotonic() < deadline:
            try:
                return arrived.get(timeout=0.5)
            except queue.Empty:
                if process.poll() is not None:
                    raise CellError(f"bench: expected a cell to come up, it ended: {last_line(said)}") from None
    raise CellError(f"bench: expected an episode within {PATIENCE_S:g} s, got none")
