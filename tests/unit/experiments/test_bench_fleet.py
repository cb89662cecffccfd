"""``bench fleet``: a fleet of real processes ends like single runs, one that does not is told, and figures add up."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from experiments.bench import fleet as bench_fleet
from experiments.bench.__main__ import main
from experiments.bench.cell import Subject
from experiments.bench.fleet import Fleet, Moment, report
from experiments.bench.processes import Usage, total
from experiments.lab.run import TimedRun, run_seed

SUBJECT = Subject("x", (), 0)


def fleet(*equal: bool) -> Fleet:
    """Return a fleet of two cells that made 400 decisions in 4 episodes and 2 s."""
    first = Moment(10.0, 100, 2, (Usage(1, 1.0), Usage(1, 2.0)), {"router": Usage(1, 0.5), "store": Usage(1, 0.1)})
    cells = (Usage(300_000_000, 1.5), Usage(320_000_000, 2.7))
    shared = {"router": Usage(50_000_000, 0.7), "store": Usage(60_000_000, 0.14)}
    return Fleet(first, Moment(12.0, 500, 6, cells, shared), equal)


def test_figures_are_of_the_time_when_all_cells_were_at_work() -> None:
    found: dict[str, Any] = dict(report(SUBJECT, 3, {}, [(2, fleet(True, True))]))
    assert found["equal"] is True
    (one,) = found["fleets"]
    assert one["equal"] == "2 of 2"
    assert one["decisions_per_s"] == pytest.approx(200)
    assert one["decisions_per_s_and_cell"] == pytest.approx(100)
    assert one["ms_per_episode_and_cell"] == pytest.approx(1000), "two cells made four in two seconds"
    assert one["cell_cpu_ms_per_decision"] == pytest.approx(3.0)
    assert one["router_cpu_us_per_decision"] == pytest.approx(500)
    assert one["store_cpu_us_per_decision"] == pytest.approx(100)
    assert one["cpu_cores_used"] == pytest.approx(0.72)
    assert one["cell_rss_mb"] == {"median": 310.0, "min": 300.0, "max": 320.0}


def test_one_cell_that_differs_is_one_too_many() -> None:
    found: dict[str, Any] = dict(report(SUBJECT, 3, {}, [(2, fleet(True, True)), (2, fleet(True, False))]))
    assert found["equal"] is False
    assert [one["equal"] for one in found["fleets"]] == ["2 of 2", "1 of 2"]


def test_processes_are_added_up() -> None:
    assert total([Usage(1, 0.5), Usage(2, 0.25)]) == Usage(3, 0.75)


def test_two_real_cells_end_as_two_single_runs(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
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


def test_a_cell_that_ends_in_other_bytes_makes_exit_status_1(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def other(*arguments: Any) -> TimedRun:
        done = run_seed(*arguments)
        digests: Any = {**done.result.digests, "q_table": "0" * 64}
        return replace(done, result=replace(done.result, digests=digests))

    monkeypatch.setattr(bench_fleet, "run_seed", other)
    assert main(["fleet", "--experiment", str(small), "--cells", "1", "--episodes", "2"]) == 1
    assert "0 of 1" in capsys.readouterr().out


@pytest.mark.parametrize(("option", "value"), [("cells", "0"), ("cells", "1,,2"), ("cells", "65"), ("episodes", "1")])
def test_a_fleet_that_cannot_be_is_one_line(option: str, value: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["fleet", f"--{option}", value])
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"--{option}: expected a whole number from" in line


def test_seeds_that_would_end_above_the_greatest_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fleet", "--seed", str(2**63 - 1), "--cells", "1,2"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--seed: expected at most" in line
