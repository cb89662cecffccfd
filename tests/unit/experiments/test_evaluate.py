"""Evaluations: controllers decide by what is felt alone, a frozen skill learns nothing, figures are the trials'."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.evaluate.controllers import (
    ACTION,
    BASELINES,
    RULE,
    RULES,
    ComplianceRule,
    RandomMoves,
    SpiralRule,
    TipRule,
)
from experiments.evaluate.figures import figures, wilson
from experiments.evaluate.frozen import FrozenSkill
from experiments.evaluate.run import Method, evaluate
from experiments.evaluate.trial import Trial, trial
from experiments.lab.in_process import InProcessRun
from experiments.leaderboard.methods import changed, methods
from services.rules import skill as skill_file
from services.rules.command_line import Parser
from services.rules.skill import NamedSkill, SkillError
from services.wire.actions import INSERT
from services.wire.definition_file import load, shipped
from services.wire.errors import TreenailError
from services.wire.messages import Force, Observation, Torque
from treenail.commands import evaluate as command

ROUND = load("suite-round")
SUITE = sorted(name for name in shipped() if name.startswith("suite-"))


def felt(force_n: Force, torque_nm: Torque = (0.0, 0.0, 0.0), step: int = 1, episode: int = 0) -> Observation:
    return Observation(
        run="r", episode=episode, step=step, decision=step, force_n=force_n, torque_nm=torque_nm, swaps=0
    )


@pytest.fixture(scope="module")
def learnt() -> NamedSkill:
    run = InProcessRun(ROUND, 3)
    list(run.episodes(12))
    return run.learnt()


def test_the_rule_gives_way_to_the_greatest_of_force_and_tilt() -> None:
    rule = ComplianceRule(ROUND)
    lever = ROUND.wrist.sensor_height_mm * 1e-3
    assert rule.decide(felt((1.0, 0.0, -2.0), (0.0, -lever, 0.0))).action == ACTION["+X"], "a push at the tip"
    assert rule.decide(felt((0.0, -1.0, -2.0), (-lever, 0.0, 0.0))).action == ACTION["-Y"]
    assert rule.decide(felt((0.0, 0.0, -2.0), (0.0, 1.0, 0.0))).action == ACTION["+RY"]
    assert rule.decide(felt((0.1, 0.0, -2.0), (0.0, -0.1 * lever, 0.0))).action == INSERT, "too little to answer"


def test_a_peg_that_is_hardly_pressed_goes_on_now_and_then() -> None:
    rule = ComplianceRule(ROUND)
    push = felt((1.0, 0.0, -0.5), (0.0, -0.13, 0.0))
    assert [rule.decide(push).action == INSERT for _ in range(6)] == [False, False, True] * 2
    rule.begin()
    assert [rule.decide(push).action == INSERT for _ in range(3)] == [False, False, True], "an episode begins anew"


def test_the_rule_keeps_to_the_moves_of_the_task() -> None:
    twist = felt((0.0, 0.0, -2.0), (0.0, 0.0, 0.5))
    assert ComplianceRule(ROUND).decide(twist).action == INSERT, "nine actions have no turn about Z"
    assert ComplianceRule(load("suite-square")).decide(twist).action == ACTION["+RZ"]


def test_the_search_widens_round_by_round() -> None:
    rule = SpiralRule(ROUND)
    flat = felt((0.0, 0.0, -2.0))
    names = {index: name for name, index in ACTION.items()}
    way = [names[rule.decide(flat).action] for _ in range(12)]
    assert way == ["+X", "+Y", "-X", "-X", "-Y", "-Y", "+X", "+X", "+X", "+Y", "+Y", "+Y"]
    assert rule.decide(felt((0.0, 0.0, -0.5))).action == INSERT, "no search where nothing presses"


def test_random_moves_depend_on_seed_episode_and_step_alone() -> None:
    first, again, other = (RandomMoves(ROUND, seed) for seed in (1, 1, 2))
    steps = [felt((1.0, 0.0, 0.0), step=step) for step in range(60)]
    moves = [first.decide(step).action for step in steps]
    assert moves == [again.decide(step).action for step in reversed(steps)][::-1]
    assert moves != [other.decide(step).action for step in steps]
    assert set(moves) == set(range(ROUND.moves.actions))


def test_a_frozen_skill_does_the_best_known_and_learns_nothing(learnt: NamedSkill) -> None:
    before = skill_file.file_bytes(learnt)
    first, again = (trial(ROUND, FrozenSkill(learnt, ROUND, 5), 5, 3) for _ in range(2))
    assert first == again
    assert skill_file.file_bytes(learnt) == before
    assert first.states <= set(range(learnt.states + 1))


def test_what_no_contact_state_fits_has_no_best_move_in_a_table() -> None:
    (table,) = methods(["table"])[:1]
    definition = changed(ROUND, table)
    run = InProcessRun(definition, 3)
    list(run.episodes(12))
    learnt = run.learnt()
    skill = FrozenSkill(learnt, definition, 5)
    strange = [skill.decide(felt((0.0, 0.0, 5.0), (0.0, 0.0, 3.0), step)) for step in range(40)]
    assert {choice.state for choice in strange} == {learnt.states}
    assert len({choice.action for choice in strange}) > 3


def test_a_skill_of_other_moves_is_refused(learnt: NamedSkill) -> None:
    with pytest.raises(SkillError, match="actions"):
        FrozenSkill(learnt, load("suite-square"), 5)


@given(st.integers(1, 10_000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_the_interval_holds_the_rate_and_mirrors(counts: tuple[int, int]) -> None:
    successes, trials = counts
    low, high = wilson(successes, trials)
    assert 0.0 <= low <= successes / trials <= high <= 1.0
    mirrored = wilson(trials - successes, trials)
    assert math.isclose(low, 1.0 - mirrored.high, abs_tol=1e-12)


def test_the_interval_is_that_of_the_tables() -> None:
    assert wilson(50, 100) == pytest.approx((0.4038, 0.5962), abs=1e-4)
    assert wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    with pytest.raises(ValueError, match="one or more"):
        wilson(0, 0)


def test_figures_are_those_of_the_trials() -> None:
    trials = [trial(ROUND, ComplianceRule(ROUND), seed, 2) for seed in (7, 8)]
    all_of_them = [summary for each in trials for summary in each.episodes]
    made = figures(trials, moves_per_s=4.0)
    assert made["episodes"] == 4
    assert made["seeds"] == [7, 8]
    assert made["greatest_force_n"] == max(summary.peak_force_n for summary in all_of_them)
    assert made["seconds"] == made["moves"] / 4.0
    none = figures([Trial(1, tuple(each for each in all_of_them[:1] if each), frozenset({0, 3}))], 1.0)
    assert none["states"] == 2


def test_methods_meet_the_same_starts_and_noise_in_any_number_of_processes() -> None:
    methods = [Method(RULE), Method("random")]
    at_once, alone = (evaluate(ROUND, methods, [11, 12], 1, 5.0, jobs) for jobs in (2, 1))
    assert at_once == alone
    assert set(at_once) == {RULE, "random"}


@pytest.mark.parametrize("name", SUITE)
def test_a_task_of_the_suite_can_be_tried(name: str) -> None:
    task = load(name)
    (summary,) = trial(task, ComplianceRule(task), 1, 1).episodes
    assert summary.decisions > 0
    assert task.noise.force_n > 0, "noise is on"
    assert task.start.xy_spread_mm > 0 or name.endswith("-start"), "starts are random"


def said(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    parser = Parser(prog="treenail evaluate")
    command.add_arguments(parser)
    command.act(parser.parse_args([*words, "--episodes", "1", "--seeds", "1", "--jobs", "1"]))
    return capsys.readouterr().out


def test_the_rule_always_stands_beside(capsys: pytest.CaptureFixture[str], learnt: NamedSkill, tmp_path: Path) -> None:
    path = tmp_path / "peg.skill"
    skill_file.write(path, learnt)
    report = json.loads(said(capsys, str(path), "--json"))
    assert report["experiment"] == "suite-round"
    assert set(report["methods"]) == {str(path), *RULES}
    table = said(capsys, "random", "--experiment", "suite-round")
    assert "force [N]" in table
    assert "random" in table
    assert "rule" in table


def test_a_baseline_needs_a_task(capsys: pytest.CaptureFixture[str]) -> None:
    for name in BASELINES:
        with pytest.raises(TreenailError, match="--experiment"):
            said(capsys, name)


def test_settings_change_the_task_that_a_skill_was_learnt_in(
    capsys: pytest.CaptureFixture[str], learnt: NamedSkill, tmp_path: Path
) -> None:
    path = tmp_path / "peg.skill"
    skill_file.write(path, learnt)
    plain, slippery, far = (
        json.loads(said(capsys, str(path), "--json", *words))["methods"]["rule"]
        for words in ([], ["--set", "contact.friction=0.0"], ["--set", "start.xy_spread_mm=0.1"])
    )
    assert plain["force_n"] != slippery["force_n"]
    assert plain["moves"] != far["moves"]
    with pytest.raises(TreenailError, match=r"--set contact.friction=9.*expected"):
        said(capsys, str(path), "--set", "contact.friction=9")


def test_two_rules_differ_by_the_point_their_torques_refer_to() -> None:
    tip_contact = felt((0.4, 0.0, -1.0), (0.0, 0.4 * ROUND.wrist.sensor_height_mm * 1e-3, 0.0), 0)
    assert ComplianceRule(ROUND).decide(tip_contact).action == ACTION["+RY"], "a force aside at the tip counts twice"
    assert TipRule(ROUND).decide(tip_contact).action == ACTION["+X"], "at the tip it turns nothing"
