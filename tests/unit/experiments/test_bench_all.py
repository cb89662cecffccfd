"""``bench all``: one table of what the benchmarks say, and the page with its history."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from experiments.bench import every, page
from experiments.bench.__main__ import SUMMARIES
from experiments.bench.every import FIGURES, PARTS, Part, table
from experiments.bench.values import machine, spread

DOCS = Path(__file__).parents[3] / "docs"


def results() -> dict[str, Any]:
    """Return results that have every figure of the table: 1, 2, 3 and so on."""
    given: dict[str, Any] = {}
    for number, figure in enumerate(FIGURES):
        place: Any = given.setdefault(figure.part, {})
        for step, following in zip(figure.path, (*figure.path[1:], None), strict=True):
            if following is None:
                place[step] = spread([float(number)])
            elif isinstance(place, list):
                while len(place) <= int(step):
                    place.append({})
                place = place[int(step)]
            else:
                place = place.setdefault(step, [] if isinstance(following, int) else {})
    return given


def report(given: dict[str, Any]) -> dict[str, Any]:
    return {"bench": "all", "machine": machine(), "results": {"parts": given, "table": table(given), "seconds": 61.0}}


def test_every_benchmark_is_a_part() -> None:
    assert {part.benchmark or part.name for part in PARTS} == set(SUMMARIES) - {"all"}
    assert sum(part.about_s for part in PARTS) < every.WITHIN_S < 600


def test_the_table_has_each_figure() -> None:
    rows: list[Any] = table(results())
    assert [row["median"] for row in rows] == list(range(len(FIGURES)))


def test_what_was_left_out_says_why() -> None:
    given = {**results(), "sim": {"left_out": "there was no time for it"}}
    del given["art2"]
    rows: dict[str, Any] = {row["what"]: row for row in table(given) if isinstance(row, dict)}
    assert rows["moves in contact"]["left_out"] == "there was no time for it"
    assert rows["ART2: the same, 12 inputs"]["left_out"] == "not measured"
    assert "not measured" in "\n".join(every.lines(report(given)))


def test_a_figure_that_says_why_it_is_not_there_is_left_out() -> None:
    given = results()
    given["sim"]["bare_mujoco_moves_per_s"] = "not measured: No module named 'mujoco'"
    text = "\n".join(every.lines(report(given)))
    assert "moves in contact: a bare MuJoCo loop" in text and "not measured: No module named 'mujoco'" in text


def test_a_benchmark_that_fails_or_takes_too_long_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(code: str, within_s: float) -> Any:
        monkeypatch.setattr(every, "module_command", lambda *_: [sys.executable, "-c", code])
        return every._run(Part("sim", (), 1.0), within_s)

    assert run('print(\'{"results": {"moves": 3}}\')', 60.0) == {"moves": 3}
    assert run("import sys; sys.exit('treenail bench: no robot')", 60.0) == {"left_out": "treenail bench: no robot"}
    assert run("import time; time.sleep(60)", 0.2) == {"left_out": "not done within 0 s"}


def test_what_finds_no_time_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(every, "module_command", lambda *_: [sys.executable, "-c", "raise SystemExit(1)"])
    parts: Any = every.measure(said.append, within_s=2.0)["parts"]
    assert len(said) == len(PARTS)
    assert parts["soak"] == {"left_out": "there was no time for it"}


def test_the_page_has_the_newest_table_and_those_before(tmp_path: Path) -> None:
    page.write(tmp_path, report(results()))
    text = page.write(tmp_path, report({**results(), "sim": {"left_out": "no robot"}})).read_text()
    assert "| moves in contact | no robot | | | |" in text
    assert len(json.loads((tmp_path / "performance.json").read_text())) == 2
    lines = [line for line in text.splitlines() if line.startswith("| 2")]
    assert len(lines) == 2
    assert len({line.count("|") for line in text.split("## Before")[1].splitlines() if line.startswith("|")}) == 1


def test_the_page_in_the_repository_is_made_of_its_history() -> None:
    assert (DOCS / "performance.md").read_text() == page.page(json.loads((DOCS / "performance.json").read_text()))
