"""``builtin``, the skill that comes with Treenail, wherever a command or a program names a skill."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pytest

import treenail
from experiments.leaderboard.methods import beginning_with
from experiments.leaderboard.plan import Length, entries
from experiments.leaderboard.suite import tasks
from experiments.leaderboard.told import told
from services.cell.plan import make_plan
from services.rules.shipped_skill import builtin, for_task
from services.rules.skill import SkillError, read
from services.wire.definition_file import load, run_id
from treenail import __main__ as command
from treenail.commands import experiment, up_options

ROUND, CHAMFERLESS = load("suite-round"), "suite-chamferless"
REFUSED = "builtin: does not fit suite-chamferless: skill: expected torques referred as Felt(torque='tip'"


def says(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    """Return status, standard output and standard error of the command."""
    monkeypatch.setattr("sys.argv", ["treenail", *words])
    with pytest.raises(SystemExit) as end:
        command.main()
    assert isinstance(end.value.code, int)
    return (end.value.code, *capsys.readouterr())


def test_a_cell_begins_with_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    parser = command_parser()
    plan = up_options.plan_of(parser.parse_args(["sim", "--skill", "builtin", "--port", "0", "--no-viewer"]))
    given = for_task(builtin(), ROUND)
    assert plan.skill == given and plan.run == run_id(plan.definition, 0, given.sha256)
    assert plan.out.name.endswith(f"-s0-k{given.sha256[:8]}")
    with pytest.raises(SkillError, match=r"^builtin: does not fit suite-chamferless: "):
        make_plan(CHAMFERLESS, skill="builtin")


def command_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser()
    up_options.add_arguments(parser)
    return parser


def test_where_it_says_nothing_that_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert experiment.main(["run", CHAMFERLESS, "--skill", "builtin", "--out", str(tmp_path / "x")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"treenail experiment: {REFUSED}")
    assert not (tmp_path / "x").exists()


def test_from_python_it_is_named_or_read() -> None:
    results = treenail.run("suite-round", seeds=[5], episodes=1, skill="builtin", jobs=1)
    (run,) = results.runs
    assert run.skill._named.skill.skill_sha256 == for_task(builtin(), ROUND).sha256
    whole = treenail.read_skill("builtin")
    assert run.skill.episodes == whole.episodes + 1
    again = treenail.run("suite-round", seeds=[5], episodes=1, skill=whole, jobs=1)
    assert again.runs[0].digests == run.digests
    with pytest.raises(treenail.TreenailError, match=r"^builtin: does not fit"):
        treenail.run(CHAMFERLESS, skill="builtin")


@pytest.mark.parametrize("key", ["learner.follow", "policy.kind", "classifier.rho", "learner"])
def test_a_setting_that_a_skill_brings_with_it_is_refused(
    key: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, err = says(monkeypatch, capsys, "evaluate", "builtin", "--set", f"{key}=0.5")
    assert status == 2 and err.count("\n") == 1
    assert err.startswith(f"treenail evaluate: --set {key}: expected a setting of the task")


def test_it_is_evaluated_beside_the_rules(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("builtin", "--experiment", "suite-round", "--episodes", "2", "--seeds", "1", "--jobs", "1", "--json")
    status, out, err = says(monkeypatch, capsys, "evaluate", *words)
    assert status == 0, err
    made = json.loads(out)["methods"]
    assert set(made) == {"builtin", "rule", "rule-tip"}
    assert made["builtin"]["success"] == 1.0
    status, _, err = says(monkeypatch, capsys, "evaluate", "builtin", "--experiment", CHAMFERLESS)
    assert status == 2 and err.startswith(f"treenail evaluate: {REFUSED}") and err.count("\n") == 1


def test_it_is_shown_and_mapped(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    status, out, _ = says(monkeypatch, capsys, "checkpoint", "show", "builtin", "--json")
    assert status == 0 and json.loads(out)["skill"] == builtin().sha256
    path = tmp_path / "mapped.skill"
    words = ("checkpoint", "map", "builtin", str(path), "--experiment", "suite-industreal-round-8")
    status, out, _ = says(monkeypatch, capsys, *words)
    assert status == 0 and "with the moves of suite-industreal-round-8" in out
    assert read(path) == for_task(builtin(), load("suite-industreal-round-8"))


def test_on_the_leaderboard_it_is_given_each_tasks_moves_and_named_where_it_does_not_fit() -> None:
    method = beginning_with("builtin")
    fits, refused = entries(tasks(["suite-round", CHAMFERLESS])[::-1], (method,), Length((200, 201), 20, 1))
    assert method.name == "with builtin" and "300 episodes" in told(method).supervision
    assert [job.skill for job in fits.jobs] == [for_task(builtin(), ROUND)] * 2
    assert not refused.jobs and refused.refused.startswith(REFUSED)
