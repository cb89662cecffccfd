"""``bench fleet``: figures add up, a cell that differs is told, and what cannot be is one line."""

from __future__ import annotations

from typing import Any

import pytest

from experiments.bench.__main__ import main
from experiments.bench.cell import Subject
from experiments.bench.fleet import Fleet, Moment, report
from experiments.bench.processes import Usage, total

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
