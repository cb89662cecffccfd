"""The leaderboard: figures by hand, verdicts, runs that are done once, and a fault that stops nobody else."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from experiments.evaluate.controllers import RULE, RULES, TIP_RULE
from experiments.lab.in_process import InProcessRun
from experiments.lab.progress import Lines
from experiments.leaderboard import jobs as jobs_module
from experiments.leaderboard import learning, plan, runner
from experiments.leaderboard.board import board
from experiments.leaderboard.boards import BOARDS, Wanted
from experiments.leaderboard.figures import FIRST, Figures, figures, ratio
from experiments.leaderboard.folder import Folder
from experiments.leaderboard.jobs import Done, Job, Order, Outcome, key, work
from experiments.leaderboard.methods import METHODS, TREENAIL, Method, changed, methods
from experiments.leaderboard.plan import Length
from experiments.leaderboard.suite import tasks
from experiments.leaderboard.targets import TARGETS, Target, target_of, verdict
from experiments.oracle.search import Effort
from services.rules import skill as skill_file
from services.wire.definition import Art2Settings, QLearning, Softmax
from services.wire.definition_file import load
from services.wire.errors import TreenailError
from treenail.commands import leaderboard as command

NUMBERS = "leaderboard.json"
ROUND = load("suite-round")
SHORT = Length((100, 101), 2, 1)


def outcome(outcomes: str, force_n: float = 0.5, moves: int = 60) -> Outcome:
    count = len(outcomes)
    return Outcome(outcomes, [-1.0] * count, [force_n] * count, [2 * force_n] * count, [moves] * count, 7, 1.5)


class Here:
    """Does the work in this process, and counts it."""

    def __init__(self) -> None:
        self.done: list[str] = []

    def __call__(
        self,
        work: Callable[[Order, Callable[[int], bool]], Done],
        keys: Sequence[Order],
        name: Callable[[Order], str],
        advanced: Callable[[int, int], None],
    ) -> Iterator[tuple[int, Done]]:
        for index, given in enumerate(keys):
            self.done.append(name(given))
            yield index, work(given, lambda _: True)


def quiet() -> Lines:
    return Lines(lambda _: None, lambda: 0.0)


def test_figures_are_those_of_the_first_and_of_the_last_episodes() -> None:
    begin, end = "c" * 3 + "i" * 17, "i" * 99 + "p"
    made = figures({5: outcome(begin + "c" * 180 + end, 0.4), 3: outcome("i" * 300, 0.2, 50)}, learns=True)
    assert made["seeds"] == [3, 5]
    assert made["first_failures"] == [0, 3]
    assert (made["first_failures_median"], made["first_failures_most"]) == (1.5, 3)
    assert (made["successes"], made["trials"], made["last"]) == (199, 200, 100)
    assert made["success_worst_seed"] == 0.99
    assert made["success_low"] < 0.995 < made["success_high"]
    assert made["force_n"] == pytest.approx({"mean": 0.3, "least": 0.2, "most": 0.4})
    assert made["moves"] is not None and made["moves"]["mean"] == pytest.approx((99 * 60 + 100 * 50) / 199)
    assert made["steady_from"] == [0, 198], "the first hundred with 98 successes are two failures and all of the end's"


def test_of_who_does_not_learn_all_episodes_count() -> None:
    made = figures({1: outcome("ic" * 20)}, learns=False)
    assert (made["successes"], made["trials"]) == (20, 40)
    assert made["first_failures"] == [FIRST // 2]
    assert figures({1: outcome("ccc")}, learns=False)["moves"] is None


def test_a_ratio_is_against_the_rule() -> None:
    ours, rule = (figures({1: outcome("i" * 9, force, moves)}, learns=False) for force, moves in ((0.2, 45), (0.4, 90)))
    assert ratio(ours, rule) == (0.5, 0.5)


AIM = Target(("suite-round",), 0, 1, 0.999, force_of_rule=0.5, moves_of_rule=0.92)


@pytest.mark.parametrize(
    ("ours", "met", "words"),
    [
        (outcome("i" * 300, 0.2, 50), True, "met"),
        (outcome("i" * 300, 0.1, 50), True, "met, easily: force against the rule 0.25, aim 0.50"),
        (outcome("cc" + "i" * 298, 0.2, 50), False, "failures at first, most 2 (at most 1)"),
        (outcome("i" * 299 + "c", 0.2, 50), False, "missed: success 99 % (at least 99.9 %)"),
        (outcome("i" * 300, 0.3, 59), False, "force against the rule 0.75 (at most 0.50); moves against the rule 0.98"),
    ],
)
def test_a_verdict_says_what_was_missed(ours: Outcome, met: bool, words: str) -> None:
    rule = figures({1: outcome("i" * 40, 0.4, 60)}, learns=False)
    told = verdict(AIM, figures({1: ours}, learns=True), rule, {})
    assert told.met is met
    assert words in told.words


def test_other_aims_are_held_against_what_they_name() -> None:
    def of(outcomes: str, force_n: float = 0.4) -> Figures:
        return figures({1: outcome(outcomes, force_n)}, learns=True)

    rule = figures({1: outcome("i" * 39 + "c")}, learns=False)
    above = Target(("x",), above_rule=True)
    assert verdict(above, of("i" * 300), rule, {}).met
    assert not verdict(above, of("i" * 290 + "c" * 10), rule, {}).met, "90 % is not above 97.5 %"
    as_aligned = Target(("x",), force_as="suite-round")
    assert verdict(as_aligned, of("i" * 300, 0.3), None, {"suite-round": of("i" * 300, 0.3)}).met
    assert not verdict(as_aligned, of("i" * 300, 0.5), None, {"suite-round": of("i" * 300, 0.3)}).met
    steady = Target(("x",), steady_median=60, steady_all=150)
    assert verdict(steady, of("c" * 50 + "i" * 250), None, {}).met
    assert "never" in verdict(steady, of("c" * 300), None, {}).words


def test_a_target_is_that_of_the_first_pattern_that_fits() -> None:
    assert target_of("suite-round") is TARGETS[0]
    assert target_of("suite-industreal-round-8") is not None
    assert target_of("initial") is None


def test_the_table_is_the_thesiss_learner_whatever_the_task_comes_with() -> None:
    (table,) = (method for method in METHODS if method.name == "table")
    changes = [
        "learner.kind=sarsa",
        "shaping.price_per_n=0.0",
        "classifier.torque_gain_per_m=31.0",
        "policy.kind=greedy",
    ]
    other = load("suite-round", changes)
    made = changed(other, table)
    assert made.learner == QLearning()
    assert made.classifier == Art2Settings(rho=0.95)
    assert made.policy == Softmax(beta=1.0, beta_per_episode=0.05)
    assert made.start == other.start


def test_every_method_can_be_tried_on_every_task() -> None:
    refused = [entry for entry in plan.entries(tasks(None), METHODS, SHORT) if entry.refused]
    assert not refused


def test_tasks_and_methods_are_named_or_meant_by_patterns() -> None:
    assert [task.name for task in tasks(["suite-round*"])] == ["suite-round", "suite-round-fine", "suite-round-tight"]
    assert {method.name for method in methods(["table"])} == {"table", *RULES}
    with pytest.raises(TreenailError, match=r"--tasks: expected some of .*suite-round"):
        tasks(["nothing"])
    with pytest.raises(TreenailError, match="--methods: expected some of treenail"):
        methods(["nothing"])


def test_what_is_done_is_not_done_again_and_what_is_the_same_is_done_once(tmp_path: Path) -> None:
    entries = plan.entries((ROUND,), methods([TREENAIL, RULE]), SHORT)
    again = Method("again", "the same", "learn")
    entries += plan.entries((ROUND,), (again,), SHORT)
    folder, here = Folder(tmp_path, lambda _: None), Here()
    page, failures = learning.make(learning.LEADERBOARD, entries, SHORT, folder, here, quiet())
    assert failures == 0
    assert sorted(here.done) == [
        f"suite-round, {name}, seed {seed}" for name in (RULE, TIP_RULE, TREENAIL) for seed in (100, 101)
    ]
    numbers = json.loads((tmp_path / NUMBERS).read_text())
    learning.make(learning.LEADERBOARD, entries, SHORT, folder, here, quiet())
    assert len(here.done) == 6, "nothing is left to do"
    assert json.loads((tmp_path / NUMBERS).read_text())["rows"] == numbers["rows"]
    rows = {row["method"]: row["figures"] for row in numbers["rows"]}
    assert {**rows["again"], "cpu_s": 0} == {**rows[TREENAIL], "cpu_s": 0}
    text = page.read_text()
    assert "| `treenail` | " in text and "missed" in text
    for picture in ("leaderboard", "leaderboard-force", "leaderboard-failures"):
        assert f"]({picture}.png)" in text
        assert (tmp_path / f"{picture}.png").read_bytes().startswith(b"\x89PNG")
    assert len(list((tmp_path / "skills").iterdir())) == 2
    for path in (tmp_path / "skills").iterdir():
        assert skill_file.read(path).skill.episodes == SHORT.episodes


def test_seeds_run_apart_make_the_same_board(tmp_path: Path) -> None:
    def rows(folder: Path, *seeds: int) -> object:
        length = Length(seeds, 1, 1)
        entries = plan.entries((ROUND,), methods([RULE]), length)
        learning.make(learning.LEADERBOARD, entries, length, Folder(folder, lambda _: None), Here(), quiet())
        made = json.loads((folder / NUMBERS).read_text())["rows"]
        return [{**row, "figures": {**row["figures"], "cpu_s": 0}} for row in made]

    rows(tmp_path / "a", 100)
    rows(tmp_path / "a", 101)
    assert rows(tmp_path / "a", 100, 101) == rows(tmp_path / "b", 100, 101)


def test_the_page_of_what_is_there_says_what_is_not(tmp_path: Path) -> None:
    entries = plan.entries((ROUND,), methods([TREENAIL]), SHORT)
    page, _ = learning.make(learning.LEADERBOARD, entries, SHORT, Folder(tmp_path, lambda _: None), None, quiet())
    assert "2 of 2 seeds not run yet" in page.read_text()


def test_a_fault_in_a_method_stops_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fault(job: Job, _: object) -> Done:
        raise ZeroDivisionError(job.name)

    monkeypatch.setitem(jobs_module._WORK, "learn", fault)
    entries = plan.entries((ROUND,), methods([TREENAIL]), SHORT)
    said = list[str]()
    reporter = Lines(said.append, lambda: 0.0)
    folder, jobs = Folder(tmp_path, lambda _: None), [job for entry in entries for job in entry.jobs]
    results = runner.run("x", jobs, folder, Here(), reporter)
    assert {job.method for job in results.outcomes} == {*RULES}
    assert {job.method for job in results.failures} == {TREENAIL}
    assert any("suite-round, treenail, seed 100: ZeroDivisionError" in line for line in said)
    (row,) = (row for row in board(entries, results).rows if row["method"] == TREENAIL)
    assert row["figures"] is None and len(row["missing"]) == 2
    here = Here()
    runner.run("x", jobs, folder, here, reporter)
    assert [name.split(", ")[1] for name in here.done] == [TREENAIL, TREENAIL], "tried again, the others are not"


def test_other_code_neither_counts_as_the_same_nor_is_run() -> None:
    job = Job("t", RULE, "play", ROUND, 1, 1)
    told = work(Order(job, "0" * 64), lambda _: True)
    assert told.outcome is None and "code: expected 000000000000" in told.failure
    assert key(job)["code"] == jobs_module.code_of(job)


def test_the_rule_is_the_same_whatever_learner_stands_in_the_definition() -> None:
    other = load("suite-round", ["learner.kind=sarsa", "shaping.price_per_n=0.0", "policy.kind=greedy"])
    assert key(Job("t", RULE, "play", ROUND, 1, 1)) == key(Job("t", RULE, "play", other, 1, 1))
    assert key(Job("t", "x", "learn", ROUND, 1, 1)) != key(Job("t", "x", "learn", other, 1, 1))


def test_the_oracle_needs_less_force_than_the_rule(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jobs_module, "ORACLE", Effort(beam=3, attempts=5))
    oracle = work(jobs_module.order(Job("t", "oracle", "oracle", ROUND, 100, 1)), lambda _: True).outcome
    rule = work(jobs_module.order(Job("t", RULE, "play", ROUND, 100, 1)), lambda _: True).outcome
    assert oracle is not None and rule is not None
    assert oracle.outcomes == "i"
    assert oracle.force_n[0] < rule.force_n[0]


@pytest.mark.parametrize(("text", "seeds"), [("100..102", [100, 101, 102]), ("7", [7]), ("1..2,9", [1, 2, 9])])
def test_seeds_are_read(text: str, seeds: list[int]) -> None:
    assert command.seeds_of(text) == seeds


@pytest.mark.parametrize("words", [["--seeds", "3..1"], ["--seeds", "1,1"], ["--seeds", "a"], ["--episodes", "0"]])
def test_wrong_words_are_refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        command.main(words)
    assert "expected" in capsys.readouterr().err


def test_an_unknown_task_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--tasks", "nothing", "--out", str(tmp_path / "x")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("treenail leaderboard: --tasks: expected some of")
    assert not (tmp_path / "x").exists()


def test_a_page_of_nothing_is_not_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--page-only", "--out", str(tmp_path / "x")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("treenail leaderboard: --page-only: expected a folder with runs")
    assert not (tmp_path / "x").exists()


def test_a_skill_is_begun_with_and_one_that_does_not_fit_is_named(tmp_path: Path) -> None:
    run = InProcessRun(ROUND, 3)
    list(run.episodes(3))
    skill_file.write(tmp_path / "peg.skill", run.learnt())
    wanted = Wanted(
        tasks=["suite-round", "suite-square"], methods=[RULE], seeds=(100,), episodes=2, baseline_episodes=1
    )
    plan_of = BOARDS["learning"](wanted._replace(skills=(str(tmp_path / "peg.skill"),)))
    page, failures = plan_of(Folder(tmp_path, lambda _: None), Here(), quiet())
    assert failures == 0
    rows = {(row["task"], row["method"]): row for row in json.loads((tmp_path / NUMBERS).read_text())["rows"]}
    assert rows["suite-round", "with peg"]["figures"]["episodes"] == 2
    assert "actions" in rows["suite-square", "with peg"]["missing"][0], "nine moves are not eleven"
    (learnt,) = (skill_file.read(path) for path in (tmp_path / "skills").iterdir())
    assert learnt.skill.episodes == 5
    assert learnt.skill.skill_sha256 == run.learnt().sha256
    text = page.read_text()
    assert "beginning with peg.skill: suite-round, 3 episodes" in text
    assert "| rewards only, before also on suite-round, 3 episodes |" in text, "what it was told stands on the page"
    assert (
        "| `rule` | a hand-written compliance rule: give way to force and torque, else step in +Z | written by hand"
        in text
    )


def test_boards_that_begin_with_nothing_take_no_skill(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--long", "--skill", "x.skill"]) == 2
    assert "--skill: expected no --long with it" in capsys.readouterr().err


def test_a_variant_is_the_tasks_learner_with_other_settings(tmp_path: Path) -> None:
    wanted = Wanted(tasks=["suite-round"], methods=[RULE], seeds=(100,), episodes=1, baseline_episodes=1)
    variants = (("bold", "policy.width=2.0"), ("wrong", "policy.width=-1"))
    BOARDS["learning"](wanted._replace(variants=variants))(Folder(tmp_path, lambda _: None), Here(), quiet())
    rows = {row["method"]: row for row in json.loads((tmp_path / NUMBERS).read_text())["rows"]}
    assert rows["bold"]["figures"]["episodes"] == 1
    assert "policy.width" in rows["wrong"]["missing"][0]
