"""A campaign against a real cell ends in the bytes of a run that nobody disturbed; and a difference would be seen."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from experiments.chaos.campaign import Settings, carry_out
from experiments.chaos.clocks import Clocks
from experiments.chaos.plan import CLOCK, KINDS, SERVICES, Disturbance, Plan, Section
from experiments.chaos.report import well
from experiments.lab.progress import Lines
from services.wire.definition_file import load

CELL = ("router", "store", "task", "sim", "classifier", "agent")
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler (cc)")


@pytest.mark.timeout(400)
def test_twenty_kills_and_one_of_everything_else_change_nothing(
    run_module: Callable[..., Any], small: Path, tmp_path: Path
) -> None:
    words = ("--experiment", str(small), "--episodes", "90", "--seed", "4", "--kills", "20", "--json")
    process = run_module("experiments.chaos", "run", *words, "--out", str(tmp_path / "A"))
    assert process.end(390.0) == 0, process.out + process.err
    found = json.loads(process.out)
    assert found["well"]
    assert found["skipped"] == {} or set(found["skipped"]) == set(CLOCK)
    done = [one for run in found["runs"] for one in run["disturbances"]]
    assert {one["kind"] for one in done} == set(KINDS) - set(found["skipped"])
    assert sum(len(one["victims"]) for one in done if one["kind"] in ("kill", "several", "again")) == 20
    assert {f"SIGKILL of {name}" for name in SERVICES} <= set(found["rows"])
    everything = found["rows"]["all"]
    assert everything["recoveries"] == everything["count"] == len(done) == found["planned"]
    assert everything["lost_steps"] == 0
    assert all(run["digests"] == run["expected"] != {} for run in found["runs"])
    assert all(run["ended_by_themselves"] == [] for run in found["runs"])


def test_compared_with_another_run_it_differs_and_says_so(
    run_module: Callable[..., Any], small: Path, tmp_path: Path
) -> None:
    words = ("--experiment", str(small), "--episodes", "12", "--kills", "1", "--kinds", "kill", "--services", "agent")
    process = run_module("experiments.chaos", "run", *words, "--control", "--out", str(tmp_path / "A"))
    assert process.end() == 1, process.err
    assert "SIGKILL of agent" in process.out
    assert "DIFFERS" in process.out
    assert "expected what the undisturbed run gives, got another q_table, art2, episodes" in process.out
    report = json.loads((tmp_path / "A" / "chaos.json").read_text())
    assert report["well"] is False
    assert report["rows"]["all"]["lost_steps"] > 0


@needs_compiler
def test_clocks_that_disagree_or_are_set_back_change_nothing(small: Path, tmp_path: Path) -> None:
    (tmp_path / "clocks").mkdir()
    forth_and_back = (
        Disturbance("skew", ("agent",), after=20, strength=3600.0),
        Disturbance("kill", ("agent",), after=5),
        Disturbance("skew", ("agent",), after=5, strength=-60.0),
        # Everybody starts again an hour before the store's newest entry was written.
        Disturbance("clock", (), after=150, strength=-3600.0),
        Disturbance("several", CELL, after=5),
        Disturbance("clock", (), after=5, strength=60.0),
    )
    plan = Plan(0, (Section(None, forth_and_back),))
    settings = Settings(str(small), (), (), load(str(small), []), 25, 1, False, tmp_path)
    runs = carry_out(settings, plan, Clocks(tmp_path / "clocks"), Lines(lambda _: None, time.monotonic))
    assert well(plan, runs), [(run.error, run.verdict) for run in runs]
    assert len(runs) == 1
