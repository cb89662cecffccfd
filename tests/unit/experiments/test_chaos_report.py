"""The verdict over a campaign: equal is equal, and whatever differs is seen."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest

from experiments.chaos.campaign import RunReport
from experiments.chaos.drive import Done
from experiments.chaos.plan import Disturbance, Plan, Section
from experiments.chaos.reference import Reference, compare, undisturbed
from experiments.chaos.report import as_json, lines, table, well
from services.cell.terminal import console
from services.wire.definition_file import load

EPISODES = 3
KILL = Disturbance("kill", ("agent",), after=5)
PLAN = Plan(0, (Section(None, (KILL,)),))


@pytest.fixture(scope="module")
def runs(small: Path) -> dict[int, Reference]:
    """What two seeds give, the first of them twice."""
    definition = load(str(small), [])
    return {key: undisturbed(definition, seed, EPISODES) for key, seed in {1: 1, 11: 1, 2: 2}.items()}


def report(run: Reference, expected: Reference, done: Done) -> RunReport:
    return RunReport(
        run.result.seed,
        None,
        [done],
        decisions=sum(len(entry.steps) for entry in run.journal),
        digests=run.result.digests,
        expected=expected.result.digests,
        verdict=compare(run.result, run.journal, expected),
    )


def shown(plan: Plan, reports: list[RunReport]) -> str:
    text = io.StringIO()
    console(least_width=120, file=text).print(table(reports))
    return "\n".join((text.getvalue(), *lines(plan, reports, {"clock": "no C compiler (cc) here"})))


def test_a_run_that_was_made_twice_is_equal(runs: dict[int, Reference]) -> None:
    found = report(runs[1], runs[11], Done(KILL, 0.5, 0.25))
    assert found.good
    assert found.verdict is not None and found.verdict.lost_steps == 0
    assert well(PLAN, [found])
    text = shown(PLAN, [found])
    assert "yes" in text and "DIFFERS" not in text
    assert text.count("[s]") == 2, "units are no markup"
    assert "1 of 1 kills" in text
    assert "skipped: the wall clock of all jumps (no C compiler (cc) here)" in text
    assert json.loads(json.dumps(as_json(PLAN, [found], {})))["rows"]["SIGKILL of agent"]["restart_s"]["median"] == 0.25


def test_another_run_differs(runs: dict[int, Reference]) -> None:
    found = report(runs[2], runs[1], Done(KILL, 0.5, 0.25))
    assert not well(PLAN, [found])
    assert found.verdict is not None and found.verdict.lost_steps > 0
    text = shown(PLAN, [found])
    assert "DIFFERS" in text and "yes" not in text
    assert "seed 2: expected what the undisturbed run gives, got another q_table, art2, episodes" in text
    assert as_json(PLAN, [found], {})["well"] is False


def test_a_decision_that_the_journal_does_not_hold_is_lost(runs: dict[int, Reference]) -> None:
    run = runs[1]
    decisions = sum(len(entry.steps) for entry in run.journal)
    without = compare(run.result, run.journal[1:], run)
    assert without == (True, len(run.journal[0].steps))
    assert compare(run.result, (), run).lost_steps == decisions > EPISODES


def test_equal_digests_alone_are_not_enough(runs: dict[int, Reference]) -> None:
    good = report(runs[1], runs[11], Done(KILL, 0.5, 0.25))
    assert not well(Plan(0, (Section(None, (KILL, KILL)),)), [good]), "not all was done"
    lame = report(runs[1], runs[11], Done(KILL, None, None, recovered=False))
    assert not well(PLAN, [lame]), "not all was got over"
    stuck = RunReport(1, None, [Done(KILL, None, None, recovered=False)], error="chaos: nothing for 120 s")
    assert not well(PLAN, [stuck])
    assert "seed 1: chaos: nothing for 120 s" in shown(PLAN, [stuck])
    assert "yes" not in shown(PLAN, [stuck])
