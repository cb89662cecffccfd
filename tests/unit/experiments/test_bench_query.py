"""``bench query``: its report is that of its rounds."""

from __future__ import annotations

from typing import Any

import pytest

from experiments.bench.__main__ import lines
from experiments.bench.cell import Subject
from experiments.bench.query import Part, Round, report

SUBJECT = Subject("chamfered-q-softmax", (), 3)
QUIET = Part((), 300.0)


def part(*latencies_ms: float, learnt_per_s: float = 290.0) -> Part:
    return Part(latencies_ms, learnt_per_s)


def test_a_report_has_the_figures_of_its_rounds() -> None:
    rounds = [
        Round(QUIET, part(1.0), part(*[1.0] * 99, 3.0), part(2.0, 2.0, 4.0)),
        Round(QUIET._replace(learnt_per_s=320.0), part(1.0), part(1.0, 2.0, 3.0), part(2.0, 9.0, learnt_per_s=250.0)),
    ]
    found: Any = report(SUBJECT, 1.0, 50.0, rounds)
    assert found["learnt_per_s_without"] == {"median": 310.0, "min": 300.0, "max": 320.0}
    assert found["by_state"]["queries"] == 103
    assert found["by_state"]["p99_ms"] == {"median": 2.0, "min": 1.0, "max": 3.0}
    assert found["by_state"]["max_ms"]["max"] == 3.0
    assert found["by_ft"]["median_ms"] == {"median": 2.0, "min": 2.0, "max": 2.0}
    assert found["by_ft"]["p99_ms"]["median"] == 6.5
    assert found["by_ft"]["learnt_per_s"] == {"median": 270.0, "min": 250.0, "max": 290.0}
    assert found["target_met"] is False
    assert any("target_p99_ms" in line for line in lines(found))


@pytest.mark.parametrize("slow", ["by_state", "by_ft"])
def test_both_ways_of_asking_have_to_meet_the_target(slow: str) -> None:
    good = Round(QUIET, part(9.0), part(4.9), part(4.9))
    assert report(SUBJECT, 1.0, 50.0, [good])["target_met"] is True, "the idle service is only for comparison"
    assert report(SUBJECT, 1.0, 50.0, [good._replace(**{slow: part(5.1)})])["target_met"] is False
