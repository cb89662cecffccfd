"""``bench viewer``: what is made of its samples, and that it can be asked for."""

from __future__ import annotations

import pytest

from experiments.bench.__main__ import main
from experiments.bench.cell import Subject
from experiments.bench.processes import MB
from experiments.bench.viewer import Sample, report

SUBJECT = Subject("x", (), 0)


def samples(growth_mb_per_s: float) -> list[Sample]:
    """A viewer that fills up for 50 s and grows from then on; a quarter of a core, 2 MB and 3 episodes a second."""
    level = [100 + 2 * second if second < 50 else 200 + growth_mb_per_s * (second - 50) for second in range(101)]
    return [
        Sample(10.0 + second, round(rss * MB), 5 + second / 4, 1000 + second * 2_000_000, 7 + second * 3)
        for second, rss in enumerate(level)
    ]


@pytest.mark.parametrize("growth_mb_per_s", [0.0, 0.5])
def test_growth_is_that_after_the_warm_up(growth_mb_per_s: float) -> None:
    found = report(SUBJECT, "8MB", samples(growth_mb_per_s))
    assert found["growth_last_half_mb_per_h"] == pytest.approx(3600 * growth_mb_per_s, abs=1e-6)
    assert found["rss_first_mb"] == 100.0
    assert found["rss_last_half_mb"] == {
        "median": pytest.approx(200 + 25 * growth_mb_per_s),
        "min": 200.0,
        "max": 200 + 50 * growth_mb_per_s,
    }


def test_rates_are_those_of_the_whole_time() -> None:
    found = report(SUBJECT, "8MB", samples(0.0))
    assert found["seconds"] == 100.0
    assert found["cpu_percent"] == pytest.approx(25.0)
    assert found["stream_mb_per_min"] == pytest.approx(120.0)
    assert found["stream_mb_per_h"] == pytest.approx(7200.0)
    assert found["episodes_per_s"] == pytest.approx(3.0)


def test_two_samples_are_enough() -> None:
    assert report(SUBJECT, "8MB", samples(0.0)[:2])["growth_last_half_mb_per_h"] == pytest.approx(7200.0)


def test_a_length_that_is_none_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["viewer", "--minutes", "0"])
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "from 1 to 1440" in line


def test_a_viewer_that_cannot_start_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["viewer", "--minutes", "1", "--memory-limit", "plenty"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("treenail bench: bench: expected viewer to run, it ended: ")
    assert "plenty" in line
