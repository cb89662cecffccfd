"""``bench viewer``: what the viewer takes from the machine beside a cell at full speed, and whether that grows."""

from __future__ import annotations

import itertools
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from experiments.bench.loop import WORKERS
from experiments.bench.processes import MB, mind, slope_per_h, usage
from experiments.bench.values import Value, spread
from services.bus.ports import free_port
from services.bus.service import Options
from services.cell.client import Client
from services.cell.supervisor import Supervisor
from services.wire.definition_file import find, load
from services.wire.errors import CellError
from services.wire.keys import EPISODE
from services.wire.messages import EpisodeSummary

ENDLESS = 1_000_000
"""Episodes: more than there is time for."""
SAMPLE_EVERY_S = 1.0
FIRST_EPISODE_WITHIN_S = 120.0


class Case(NamedTuple):
    """What is run."""

    experiment: str
    overrides: tuple[str, ...]
    seed: int
    seconds: float
    """Length of the measurement, from the first finished episode."""
    memory_limit: str
    """The viewer's."""


class Sample(NamedTuple):
    """The viewer's process at one moment."""

    time_s: float
    rss_bytes: int
    cpu_s: float
    """Processor time so far, all threads."""
    sent_bytes: int
    """What it has handed out, as a recording."""
    episodes: int
    """Finished episodes of the cell so far."""


def measure(case: Case) -> dict[str, Value]:
    """Run a cell with a viewer for a while. Raises CellError when a process of it ends."""
    load(case.experiment, case.overrides)
    with tempfile.TemporaryDirectory(prefix="treenail-bench-") as name:
        folder = Path(name)
        supervisor = Supervisor(folder, lambda _: None)
        try:
            samples = _watch(case, supervisor, folder, f"tcp/127.0.0.1:{free_port()}")
        finally:
            supervisor.stop()
    return report(case, samples)


def report(case: Case, samples: Sequence[Sample]) -> dict[str, Value]:
    """Return the figures of two or more samples; growth is that of their last half, after the warm-up."""
    first, middle, last = samples[0], samples[len(samples) // 2], samples[-1]
    late = samples[len(samples) // 2 :] if len(samples) > 3 else samples
    sizes = [sample.rss_bytes / MB for sample in late]
    seconds = last.time_s - first.time_s
    rate = (last.sent_bytes - first.sent_bytes) / MB / (seconds / 60)
    return {
        "experiment": case.experiment,
        "seed": case.seed,
        "seconds": round(seconds, 1),
        "memory_limit": case.memory_limit,
        "episodes_per_s": (last.episodes - first.episodes) / seconds,
        "rss_first_mb": first.rss_bytes / MB,
        "rss_middle_mb": middle.rss_bytes / MB,
        "rss_last_mb": last.rss_bytes / MB,
        "rss_last_half_mb": spread(sizes),
        "growth_last_half_mb_per_h": slope_per_h([sample.time_s for sample in late], sizes),
        "stream_mb_per_min": rate,
        "stream_mb_per_h": 60 * rate,
        "cpu_percent": 100 * (last.cpu_s - first.cpu_s) / seconds,
    }


def _watch(case: Case, supervisor: Supervisor, folder: Path, endpoint: str) -> list[Sample]:
    recording = folder / "run.rrd"
    counter = itertools.count(1)
    finished = [0]

    def count(_: EpisodeSummary) -> None:
        finished[0] = next(counter)

    cell = ("--cell", "bench", "--connect", endpoint)
    overrides = [word for item in case.overrides for word in ("--set", item)]
    length = ("--seed", str(case.seed), "--episodes", str(ENDLESS))
    supervisor.start("router", "--listen", endpoint)
    with Client(Options("bench", (endpoint,))) as client:
        client.subscribe(EPISODE, EpisodeSummary, count)
        serve = ("--bind", "127.0.0.1", "--port", "0", "--no-web", "--memory-limit", case.memory_limit)
        supervisor.start("viewer", *cell, *serve, "--save", str(recording))
        supervisor.start("store", *cell, "--file", str(folder / "store.sqlite"))
        supervisor.start("task", *cell, "--experiment", str(find(case.experiment).resolve()), *overrides, *length)
        for name in WORKERS:
            supervisor.start(name, *cell)
        deadline = time.monotonic() + FIRST_EPISODE_WITHIN_S
        while not finished[0]:
            mind(supervisor)
            if time.monotonic() > deadline:
                raise CellError(f"bench: expected an episode within {FIRST_EPISODE_WITHIN_S:g} s, got none")
            time.sleep(0.1)
        samples: list[Sample] = []
        due = start = time.monotonic()
        while due <= start + case.seconds:
            time.sleep(max(0.0, due - time.monotonic()))
            mind(supervisor)
            process = supervisor.children["viewer"].process
            assert process is not None
            samples.append(_sample(process.pid, time.monotonic() - start, recording, finished[0]))
            due += SAMPLE_EVERY_S
    return samples


def _sample(pid: int, time_s: float, recording: Path, episodes: int) -> Sample:
    sent = recording.stat().st_size if recording.exists() else 0
    return Sample(time_s, *usage(pid), sent, episodes)
