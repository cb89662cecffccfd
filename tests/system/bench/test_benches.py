"""Benches with real cells, as short as they can be. No test looks at how long it took."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from experiments.bench import fleet as bench_fleet
from experiments.bench.__main__ import main
from experiments.lab.run import TimedRun, run_seed


def test_a_fleet_of_two_cells_ends_as_two_single_runs(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--experiment", str(small), "--cells", "2", "--episodes", "3", "--seed", "5", "--json")
    assert main(["fleet", *words]) == 0
    found = json.loads(capsys.readouterr().out)["results"]
    assert found["equal"] is True
    (one,) = found["fleets"]
    assert (one["cells"], one["equal"]) == (2, "2 of 2")
    assert one["decisions_per_s"] > 0
    keys = found["messages_per_decision"]
    assert {"ft", "observation", "state", "action", "reward", "episode", "journal", "home and move"} <= set(keys)
    for name in ("observation", "state", "action", "reward"):
        assert keys[name]["messages"] >= 1
        assert keys[name]["bytes"] > 40
    assert keys["ft"]["messages"] >= keys["home and move"]["questions"] > 1, "a motion and its sample"


def test_a_cell_of_a_fleet_that_ends_in_other_bytes_makes_exit_status_1(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def other(*arguments: Any) -> TimedRun:
        done = run_seed(*arguments)
        digests: Any = {**done.result.digests, "q_table": "0" * 64}
        return replace(done, result=replace(done.result, digests=digests))

    monkeypatch.setattr(bench_fleet, "run_seed", other)
    assert main(["fleet", "--experiment", str(small), "--cells", "1", "--episodes", "2"]) == 1
    assert "0 of 1" in capsys.readouterr().out


def test_queries_are_asked_of_a_cell(run_module: Callable[..., Any]) -> None:
    short = ("--set", "limits.move_limit=30", "--set", "start.height_mm=0.2")
    process = run_module("experiments.bench.__main__", "query", "--rounds", "1", "--seconds", "1", "--json", *short)
    assert process.end() == 0, process.err
    assert process.err == ""
    found = json.loads(process.out)["results"]
    for kind in ("idle", "by_state", "by_ft"):
        assert found[kind]["queries"] > 5
        assert (
            0 < found[kind]["median_ms"]["median"] <= found[kind]["p99_ms"]["median"] <= found[kind]["max_ms"]["median"]
        )
        assert found[kind]["learnt_per_s"]["median"] > 0
    assert found["learnt_per_s_without"]["median"] > 0


def test_a_short_soak_loses_nothing(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["soak", "--minutes", "0.03", "--experiment", str(small), "--in-packet", "16", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["results"]
    workers = {"router", "store", "task", "sim", "classifier", "agent", "ft_send", "ft_receive"}
    assert set(found["processes"]) == workers
    assert all(one["rss_last_mb"] > 10 for one in found["processes"].values())
    assert found["episodes"] > 0
    stream = found["ft_stream"]
    assert stream["samples_sent"] > 0
    assert stream["samples_sent"] % 16 == 0
    lost = ("samples_lost", "gaps", "out_of_order", "refused")
    assert [stream[name] for name in lost] == [0, 0, 0, 0]
    assert 0 < stream["latency_median_ms"] <= stream["latency_p99_ms"] <= stream["latency_max_ms"]
    assert found["store"]["peaks_mb"][0] > 0


@pytest.mark.timeout(600)
def test_runs_come_out_alike_with_one_worker_and_with_two(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cluster", "--runs", "2", "--episodes", "4", "--rounds", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["results"]
    assert told["equal"] is True
    assert told["one_worker_runs_per_min"]["median"] > 0
