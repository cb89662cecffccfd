"""A leaderboard's runs on a Dask cluster of real processes: who dies costs its job only, figures are the same."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from distributed import Client

RUNS = ("--tasks", "suite-round", "--methods", "table", "--seeds", "100..105", "--baseline-episodes", "2")
LEARNT = 6
"""Runs that take a second or more; the rule's take a tenth."""
ALL = 18
STARTS_S = 120.0


class Cluster:
    """A scheduler and its workers."""

    def __init__(self, run_module: Callable[..., Any], wait_until: Callable[..., None], folder: Path) -> None:
        self._run, self._wait = run_module, wait_until
        file = folder / "scheduler.json"
        self.scheduler = run_module(
            "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-show",
            "--scheduler-file", str(file),
        )  # fmt: skip
        wait_until("the scheduler listens", lambda: file.exists() and file.read_text().endswith("}"), STARTS_S)
        self.address = json.loads(file.read_text())["address"]
        self.client = Client(self.address)  # type: ignore[no-untyped-call]
        self.workers: dict[str, Any] = {}

    def work(self, count: int) -> None:
        """Start workers and wait for them."""
        for _ in range(count):
            name = f"w{len(self.workers)}"
            self.workers[name] = self._run(
                "distributed.cli.dask_worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard",
                "--name", name,
            )  # fmt: skip
        self._wait("all workers are there", lambda: len(self._addresses()) == len(self.workers), STARTS_S)

    def busy(self) -> list[str]:
        """Return the names of the workers that have a run under way."""
        processing = self.client.processing()  # type: ignore[no-untyped-call]
        return [name for address, name in self._addresses().items() if processing.get(address)]

    def _addresses(self) -> dict[str, str]:
        workers = self.client.scheduler_info(n_workers=-1)["workers"]
        return {address: worker["name"] for address, worker in workers.items()}


@pytest.fixture
def cluster(run_module: Callable[..., Any], wait_until: Callable[..., None], short_path: Path) -> Any:
    made = Cluster(run_module, wait_until, short_path)
    yield made
    made.client.close()  # type: ignore[no-untyped-call]


def results(folder: Path) -> dict[str, Any]:
    """Return what was kept of each run, by its file; the time that it took is no result."""
    entries = {path.name: json.loads(path.read_bytes()) for path in (folder / "runs").glob("*.json")}
    return {name: {**entry["value"], "cpu_s": 0} for name, entry in entries.items()}


@pytest.mark.timeout(600)
def test_a_worker_that_dies_in_mid_job_costs_its_job_only(
    cluster: Cluster, run_module: Callable[..., Any], wait_until: Callable[..., None], tmp_path: Path
) -> None:
    cluster.work(2)
    there, here = tmp_path / "there", tmp_path / "here"
    words = ("treenail.__main__", "leaderboard", *RUNS, "--episodes", "25")
    board = run_module(*words, "--on", cluster.address, "--out", str(there))
    wait_until("a result and both at work", lambda: results(there) and len(cluster.busy()) == 2, STARTS_S)
    assert len(results(there)) < LEARNT, "the longest runs come first"
    cluster.workers["w0"].stop(signal.SIGKILL)
    assert board.end(STARTS_S) == 0, board.err
    assert "2 workers at tcp://" in board.err
    assert run_module(*words, "--jobs", "1", "--out", str(here)).end(2 * STARTS_S) == 0
    apart, alone = results(there), results(here)
    assert len(alone) == ALL
    assert apart == alone, "episodes and digests are those of one machine"
    assert sum(value["digests"] is not None for value in apart.values()) == LEARNT
    again = run_module(*words, "--on", cluster.address, "--out", str(there))
    assert again.end(STARTS_S) == 0
    assert f"0 of {ALL} runs to do" in again.err


@pytest.mark.timeout(600)
def test_when_the_scheduler_goes_a_second_start_goes_on_here(
    cluster: Cluster, run_module: Callable[..., Any], wait_until: Callable[..., None], tmp_path: Path
) -> None:
    cluster.work(1)
    words = ("treenail.__main__", "leaderboard", *RUNS, "--episodes", "25", "--out", str(tmp_path))
    board = run_module(*words, "--on", cluster.address)
    wait_until("a result", lambda: results(tmp_path), STARTS_S)
    cluster.client.close()  # type: ignore[no-untyped-call]
    cluster.scheduler.stop(signal.SIGKILL)
    assert board.end(STARTS_S) == 2
    assert board.err.splitlines()[-1].startswith("treenail leaderboard: --on: the scheduler at tcp://"), board.err
    kept = len(results(tmp_path))
    assert 0 < kept < ALL
    again = run_module(*words, "--jobs", "1")
    assert again.end(2 * STARTS_S) == 0
    assert f"{ALL - kept} of {ALL} runs to do" in again.err
