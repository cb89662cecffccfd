"""What a second worker is worth: runs of a leaderboard on a Dask cluster of this machine, with one worker and with two.

Both are measured in turn, round by round, so that whatever else the machine does meets both alike.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from distributed import Client

from experiments.bench.values import Value, spread
from experiments.lab import cluster
from experiments.leaderboard.jobs import Done, Job, Order, order, work
from experiments.leaderboard.methods import TREENAIL
from services.rules.command_line import module_command
from services.wire.definition import Definition
from services.wire.errors import TreenailError

STARTS_S = 120.0
"""How long scheduler and workers may take to be there."""
WORKERS = ("first", "second")


def measure(definition: Definition, seed: int, runs: int, episodes: int, rounds: int) -> dict[str, Value]:
    """Return runs a minute with one and with two workers, ``rounds`` times each, and whether all came out alike."""
    jobs = [Job(definition.name, TREENAIL, "learn", definition, seed + number, episodes) for number in range(runs)]
    orders = [order(job) for job in jobs]
    speeds: dict[int, list[float]] = {1: [], 2: []}
    came_out = list[list[object]]()
    with tempfile.TemporaryDirectory() as folder, _cluster(Path(folder) / "scheduler.json") as address:
        for name in WORKERS:  # what is compiled in a process is compiled once
            _do(address, orders[:1], [name])
        for _ in range(rounds):
            for count, speed in speeds.items():
                began_s = time.perf_counter()
                came_out.append(_do(address, orders, WORKERS[:count]))
                speed.append(60.0 * runs / (time.perf_counter() - began_s))
    return {
        "runs_in_a_round": runs,
        "episodes_in_a_run": episodes,
        "one_worker_runs_per_min": spread(speeds[1]),
        "two_workers_runs_per_min": spread(speeds[2]),
        "two_against_one": sum(speeds[2]) / sum(speeds[1]),
        "equal": all(each == came_out[0] for each in came_out),
    }


def _do(address: str, orders: Sequence[Order], workers: Sequence[str]) -> list[object]:
    """Let some workers do the runs; return the digests of what was learnt, in order. Raises TreenailError."""
    digests = dict[int, object]()
    for index, done in cluster.spread(address, work, orders, lambda _: None, workers=list(workers)):
        if not isinstance(done, Done) or done.outcome is None:
            raise TreenailError(
                f"bench: {orders[index].job.name}: {done.why if isinstance(done, cluster.Lost) else done.failure}"
            )
        digests[index] = done.outcome.digests
    return [digests[index] for index in sorted(digests)]


@contextmanager
def _cluster(file: Path) -> Iterator[str]:
    """Run a scheduler and two workers of one process each on this machine, and give the scheduler's address."""
    listens = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-show", "--scheduler-file", str(file))
    alone = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--name")
    with ExitStack() as stack:
        scheduler = stack.enter_context(_process("distributed.cli.dask_scheduler", *listens))
        _wait("the scheduler", scheduler, lambda: file.exists() and file.read_text().endswith("}"))
        address = str(json.loads(file.read_text())["address"])
        for name in WORKERS:
            worker = stack.enter_context(_process("distributed.cli.dask_worker", address, *alone, name))
        with Client(address) as client:  # type: ignore[no-untyped-call]
            _wait("the workers", worker, lambda: len(client.scheduler_info(n_workers=-1)["workers"]) == len(WORKERS))
        yield address


@contextmanager
def _process(module: str, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run a module of Dask's, which says nothing, and end it."""
    quiet = subprocess.DEVNULL
    with subprocess.Popen(module_command(module, *words), stdin=quiet, stdout=quiet, stderr=quiet) as process:
        try:
            yield process
        finally:
            process.kill()


def _wait(what: str, process: subprocess.Popen[bytes], holds: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + STARTS_S
    while not holds():
        if process.poll() is not None or time.monotonic() > deadline_s:
            raise TreenailError(f"bench: expected {what} within {STARTS_S:g} s, got nothing")
        time.sleep(0.05)
