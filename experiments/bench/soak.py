"""``bench soak``: a cell at full speed for a long time, beside a fast F/T stream: does anything grow or get lost?

The stream has a cell name of its own, as the learning cell's ``ft`` has its one owner, and shares the router.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.bench.cell import MeasuredCell, Subject, measured_cell, moments
from experiments.bench.ft_stream import SENDER
from experiments.bench.processes import MB, Usage, slope_per_h, usages
from experiments.bench.values import Value
from services.bus.command import DIE_WITH_PARENT
from services.cell.supervisor import last_line
from services.rules.command_line import module_command
from services.wire.errors import CellError
from services.wire.keys import Keys

STREAM_CELL = "bench-ft"
SAMPLE_EVERY_S = 1.0
LEAST_SAMPLES = 30
STREAM_WITHIN_S = 60.0
STOP_WITHIN_S = 30.0
TARGET_P99_MS = 2.0
WARM_UP = 1 / 3
"""Share of the time before memory is judged."""
FLAT_MB = 1.0
"""A process is flat when it rises by at most so much after the warm-up: what an allocator takes and gives back."""
CYCLES = 3
"""The store's size can be judged once it has forgotten so often."""
SAME_PEAK = 1.1
"""A peak of the store's size that is at most so many times an earlier one is the same."""


class Sample(NamedTuple):
    """Everything at one moment."""

    time_s: float
    episodes: int
    """Finished so far."""
    decisions: int
    processes: Mapping[str, Usage]
    store_bytes: int
    """The store's file and its log."""
    forgot: int
    """How often the store has forgotten episodes so far."""


class Stream(NamedTuple):
    """What the two ends of the stream say at the end."""

    real_time: bool
    """Whether router and stream had real-time priority."""
    sent: Mapping[str, float]
    received: Mapping[str, float]


def measure(subject: Subject, seconds: float, in_packet: int, keep_episodes: int) -> dict[str, Value]:
    """Run a cell and a stream for so long, from the first finished episode. Raises CellError when a process ends.

    ``in_packet`` F/T samples are in a packet of the stream; the store keeps ``keep_episodes`` at least.
    """
    options = {"store": ("--keep-episodes", str(keep_episodes))}
    with measured_cell(subject.plan(), options=options, ahead=_ahead()) as measured:
        measured.wait()
        plan = measured.cell.plan
        with _streaming(plan.endpoint, in_packet, plan.logs) as (pids, end):
            _wait_for_stream(measured, pids)
            samples = _samples(measured, seconds, pids)
            return report(subject, in_packet, keep_episodes, samples, end())


def report(
    subject: Subject, in_packet: int, keep_episodes: int, samples: Sequence[Sample], stream: Stream
) -> dict[str, Value]:
    """Return the figures of two or more samples."""
    first, last = samples[0], samples[-1]
    seconds = last.time_s - first.time_s
    memory = {name: _process(name, samples) for name in first.processes}
    return {
        "experiment": subject.experiment,
        "seed": subject.seed,
        "seconds": round(seconds, 1),
        "episodes": last.episodes - first.episodes,
        "episodes_per_s": (last.episodes - first.episodes) / seconds,
        "decisions_per_s": (last.decisions - first.decisions) / seconds,
        "processes": memory,
        "all_flat": all(figures["memory"] == "flat" for figures in memory.values()),
        "smallest_growth_told_mb_per_h": FLAT_MB * 3600 / (samples[-1].time_s * (1 - WARM_UP)),
        "store": _store(keep_episodes, samples),
        "ft_stream": _stream(in_packet, stream),
    }


def _process(name: str, samples: Sequence[Sample]) -> dict[str, Value]:
    """Return what one process takes; its slope is that after the warm-up."""
    end = samples[-1].time_s
    late = [sample for sample in samples if sample.time_s >= WARM_UP * end]
    slope = slope_per_h([sample.time_s for sample in late], [sample.processes[name].rss_bytes / MB for sample in late])
    first, last = samples[0].processes[name], samples[-1].processes[name]
    rise = slope * (late[-1].time_s - late[0].time_s) / 3600
    return {
        "memory": "grows" if rise > FLAT_MB else "flat",
        "slope_mb_per_h": slope,
        "rise_mb": rise,
        "rss_first_mb": first.rss_bytes / MB,
        "rss_last_mb": last.rss_bytes / MB,
        "cpu_percent": 100 * (last.cpu_s - first.cpu_s) / (end - samples[0].time_s),
    }


def _store(keep_episodes: int, samples: Sequence[Sample]) -> dict[str, Value]:
    """Return how the store's size went: a saw, which rises until it forgets, higher where it holds longer episodes."""
    filling = [sample for sample in samples if sample.forgot == 0]
    last = samples[-1].forgot
    peaks = [
        max((sample for sample in samples if sample.forgot == cycle), key=lambda sample: sample.store_bytes)
        for cycle in _cycles(samples)
    ]
    if last < CYCLES:
        size = "too short to say"  # the last cycle is not over, and the first one began with an empty file
    else:
        first, *others = peaks[1:-1]
        held = _decisions_held(keep_episodes, samples, first)
        allowed = [
            SAME_PEAK * max(1.0, _decisions_held(keep_episodes, samples, sample) / held) * first.store_bytes
            for sample in others
        ]
        within = all(sample.store_bytes <= most for sample, most in zip(others, allowed, strict=True))
        size = "bounded" if within else "grows"
    per_hour = slope_per_h([sample.episodes for sample in filling], [float(sample.store_bytes) for sample in filling])
    return {
        "size": size,
        "keep_episodes": keep_episodes,
        "forgot": last,
        "peaks_mb": [sample.store_bytes / MB for sample in peaks],
        "decisions_held_at_peaks": [round(_decisions_held(keep_episodes, samples, sample)) for sample in peaks],
        "last_mb": samples[-1].store_bytes / MB,
        "bytes_per_episode_while_filling": per_hour / 3600,
    }


def _decisions_held(keep_episodes: int, samples: Sequence[Sample], now: Sample) -> float:
    """Return how many decisions the store holds: those since it forgot last, and of the episodes that it kept then."""
    since = next(sample for sample in samples if sample.forgot == now.forgot).episodes if now.forgot else 0
    episodes, decisions = [sample.episodes for sample in samples], [sample.decisions for sample in samples]
    return now.decisions - float(np.interp(max(0, since - keep_episodes), episodes, decisions))


def _cycles(samples: Sequence[Sample]) -> list[int]:
    return sorted({sample.forgot for sample in samples})


def _stream(in_packet: int, stream: Stream) -> dict[str, Value]:
    real_time, sent, received = stream
    lost = int(sent["samples"] - received["samples"])
    period_ms = 1000 * sent["seconds"] / sent["samples"]
    p99_ms = received["p99_ms"]
    return {
        "samples_sent": int(sent["samples"]),
        "samples_lost": lost,
        "gaps": int(received["gaps"]),
        "out_of_order": int(received["out_of_order"]),
        "refused": int(received["refused"]),
        "samples_in_packet": in_packet,
        "real_time_priority": real_time,
        "samples_per_s": sent["samples"] / sent["seconds"],
        "latency_median_ms": received["median_ms"],
        "latency_p99_ms": p99_ms,
        "latency_max_ms": received["max_ms"],
        "oldest_sample_p99_ms": p99_ms + (in_packet - 1) * period_ms,
        "sender_late_median_ms": sent["late_median_ms"],
        "sender_late_p99_ms": sent["late_p99_ms"],
        "sender_late_max_ms": sent["late_max_ms"],
        "target_p99_ms": TARGET_P99_MS,
        "target_met": lost == 0 and p99_ms < TARGET_P99_MS,
    }


def _wait_for_stream(measured: MeasuredCell, stream: Mapping[str, int]) -> None:
    """Return when the sender is about to begin. Raises CellError when it does not come to that."""
    key, deadline = Keys(STREAM_CELL).alive(SENDER), time.monotonic() + STREAM_WITHIN_S
    while not any(reply.ok for reply in measured.client.session.liveliness().get(key, timeout=1.0)):
        usages(measured.cell.supervisor, stream)
        if time.monotonic() > deadline:
            raise CellError(f"bench: expected the stream to begin within {STREAM_WITHIN_S:g} s, it did not")
        time.sleep(0.05)


def _samples(measured: MeasuredCell, seconds: float, stream: Mapping[str, int]) -> list[Sample]:
    samples: list[Sample] = []
    plan = measured.cell.plan
    for time_s in moments(seconds, min(SAMPLE_EVERY_S, seconds / LEAST_SAMPLES)):
        processes = usages(measured.cell.supervisor, stream)
        size = sum(file.stat().st_size for file in plan.out.glob("store.sqlite*"))
        forgot = (plan.logs / "store.log").read_text(errors="replace").count("forgot ")
        samples.append(Sample(time_s, len(measured.summaries), measured.decisions, processes, size, forgot))
    return samples


@contextmanager
def _streaming(endpoint: str, in_packet: int, folder: Path) -> Iterator[tuple[dict[str, int], Callable[[], Stream]]]:
    """Run both ends of the stream; give their process ids, and what stops them and returns their figures."""
    words = ("--cell", STREAM_CELL, "--connect", endpoint, "--in-packet", str(in_packet))
    environment = {**os.environ, DIE_WITH_PARENT: str(os.getpid())}
    started: dict[str, subprocess.Popen[bytes]] = {}
    with _ahead() as real_time:
        for part in ("receive", "send"):
            with (folder / f"{part}.out").open("wb") as out, (folder / f"{part}.log").open("wb") as log:
                command = module_command("experiments.bench.ft_stream", part, *words)
                started[part] = subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, stdout=out, stderr=log, env=environment, start_new_session=True
                )

    def end() -> Stream:
        # The sender first: the receiver then waits for what is still on its way.
        sent = _result_of(started["send"], folder / "send.out", folder / "send.log")
        return Stream(real_time, sent, _result_of(started["receive"], folder / "receive.out", folder / "receive.log"))

    try:
        yield {f"ft_{part}": process.pid for part, process in started.items()}, end
    finally:
        for process in started.values():
            process.kill()
        for process in started.values():
            process.wait()


@contextmanager
def _ahead() -> Iterator[bool]:
    """Start processes meanwhile with real-time priority where we may, as a sensor's samples do not wait for a learner.

    Gives whether they get it.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    except PermissionError:
        yield False
        return
    try:
        yield True
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def _result_of(process: subprocess.Popen[bytes], out: Path, log: Path) -> dict[str, float]:
    """Stop one end of the stream and return its figures. Raises CellError when it has none."""
    process.send_signal(signal.SIGTERM)
    try:
        status = process.wait(STOP_WITHIN_S)
    except subprocess.TimeoutExpired:
        raise CellError(f"bench: expected the stream to stop within {STOP_WITHIN_S:g} s, it did not") from None
    said = last_line(out)
    if status != 0 or not said.startswith("{"):
        raise CellError(f"bench: expected the figures of the stream, got exit status {status}: {last_line(log)}")
    result: dict[str, float] = json.loads(said)
    return result
