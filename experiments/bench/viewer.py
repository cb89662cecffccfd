"""``bench viewer``: what the viewer takes from the machine beside a cell at full speed, and whether that grows."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from experiments.bench.cell import MeasuredCell, Subject, measured_cell, moments
from experiments.bench.processes import MB, slope_per_h, usage
from experiments.bench.values import Value, spread
from services.cell.plan import viewer_at

SAMPLE_EVERY_S = 1.0


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


def measure(subject: Subject, seconds: float, memory_limit: str) -> dict[str, Value]:
    """Run a cell with a viewer for so long, from its first finished episode. Raises CellError when a process ends.

    ``memory_limit`` is the viewer's.
    """
    with tempfile.TemporaryDirectory(prefix="treenail-bench-") as name:
        recording = Path(name) / "run.rrd"
        plan = replace(subject.plan(), viewer=viewer_at("127.0.0.1", 0, None, recording))
        with measured_cell(plan, options={"viewer": ("--memory-limit", memory_limit)}) as measured:
            measured.wait()
            return report(subject, memory_limit, _samples(measured, seconds, recording))


def report(subject: Subject, memory_limit: str, samples: Sequence[Sample]) -> dict[str, Value]:
    """Return the figures of two or more samples; growth is that of their last half, after the warm-up."""
    first, middle, last = samples[0], samples[len(samples) // 2], samples[-1]
    late = samples[len(samples) // 2 :] if len(samples) > 3 else samples
    sizes = [sample.rss_bytes / MB for sample in late]
    seconds = last.time_s - first.time_s
    rate = (last.sent_bytes - first.sent_bytes) / MB / (seconds / 60)
    return {
        "experiment": subject.experiment,
        "seed": subject.seed,
        "seconds": round(seconds, 1),
        "memory_limit": memory_limit,
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


def _samples(measured: MeasuredCell, seconds: float, recording: Path) -> list[Sample]:
    samples: list[Sample] = []
    for time_s in moments(seconds, SAMPLE_EVERY_S):
        measured.mind()
        process = measured.cell.supervisor.children["viewer"].process
        assert process is not None
        sent = recording.stat().st_size if recording.exists() else 0
        samples.append(Sample(time_s, *usage(process.pid), sent, len(measured.summaries)))
    return samples
