"""Boards beside the leaderboard itself: a frozen skill elsewhere, long runs, parts left out."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from experiments.evaluate.controllers import RULES
from experiments.lab.progress import Lines
from experiments.leaderboard import ablation, lasting, transfer
from experiments.leaderboard.boards import BOARDS, Wanted
from experiments.leaderboard.folder import Folder
from experiments.leaderboard.jobs import order, work
from experiments.leaderboard.lasting import Kept, kept
from experiments.leaderboard.methods import METHODS, TREENAIL, changed
from experiments.leaderboard.transfer import CASES, task_of
from services.rules.skill import fits
from services.wire.definition import QLearning
from services.wire.definition_file import definition_sha256, load, shipped
from services.wire.errors import DefinitionError, TreenailError
from treenail.commands import leaderboard as command

LEARNER = next(method for method in METHODS if method.name == TREENAIL)


@pytest.mark.parametrize(
    ("outcomes", "changes_at", "told"),
    [
        ("i" * 300, None, Kept(0, 100)),
        ("c" * 20 + "i" * 280, None, Kept(19, 99)),
        ("i" * 150 + "cc" + "i" * 148, None, Kept(0, 98)),
        ("ci" * 150, None, Kept(None, None)),
        ("i" * 99, None, Kept(None, None)),
        ("i" * 400 + "c" * 30 + "i" * 370, 400, Kept(0, 99, 29)),
        ("i" * 400 + "c" * 400, 400, Kept(0, 100, None)),
        ("i" * 400 + "i" * 100 + "cccc" + "i" * 96, 400, Kept(0, 96, 0)),
        ("i" * 300, 400, Kept(0, 100)),
    ],
)
def test_what_is_kept_is_counted_in_windows(outcomes: str, changes_at: int | None, told: Kept) -> None:
    assert kept(outcomes, changes_at) == told


def test_a_skill_that_is_to_be_carried_is_learnt_with_the_force_that_stays_unless_a_method_says_otherwise() -> None:
    case = CASES[0]
    assert not load(case.task).learner.force_stays  # type: ignore[union-attr]
    assert task_of(case, LEARNER).learner.force_stays  # type: ignore[union-attr]
    unknown = LEARNER._replace(overrides=("learner.force_stays=false",))
    assert not task_of(case, unknown).learner.force_stays  # type: ignore[union-attr]
    table = next(method for method in METHODS if method.name == "table")
    assert isinstance(task_of(case, table).learner, QLearning)


def test_cases_differ_from_what_is_learnt_in_what_they_say_alone() -> None:
    learnt = task_of(CASES[0], LEARNER)
    by_name = {case.name: task_of(case, LEARNER) for case in CASES if case.task in shipped()}
    assert learnt.moves == load(transfer.MOVES_OF).moves
    assert by_name["friction 0.8"].contact.friction == 0.8
    assert by_name["clearance 0.1 mm"].parts.clearance_mm == 0.1
    assert by_name["square"].parts.shape == "square"
    mirrored, direct = by_name["the thesis's start, mirrored"].start, by_name["the thesis's start"].start
    assert (mirrored.x_mm, mirrored.rx_deg) == (-direct.x_mm, -direct.rx_deg)
    assert direct == load("chamfered-q-softmax").start
    for name, definition in by_name.items():
        assert name == "as learnt" or definition != learnt


def run(board: str, wanted: Wanted, folder: Path) -> dict[str, dict[str, object]]:
    plan = BOARDS[board](wanted)
    quiet = Lines(lambda _: None, lambda: 0.0)

    def here(work, keys, name, advanced):  # type: ignore[no-untyped-def]  # as runner.Spread has it
        for index, given in enumerate(keys):
            yield index, work(given, lambda _: True)

    page, failures = plan(Folder(folder, lambda _: None), here, quiet)
    assert failures == 0
    rows = json.loads(page.with_suffix(".json").read_text())["rows"]
    return {f"{row['task']}, {row['method']}": row for row in rows}


def test_a_skill_is_tried_where_it_was_not_learnt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transfer, "CASES", CASES[:1] + CASES[4:5])
    wanted = Wanted(seeds=(100,), episodes=3, baseline_episodes=1)
    rows = run("transfer", wanted, tmp_path)
    assert set(rows) == {f"{case}, {name}" for case in ("as learnt", "friction 0.1") for name in (TREENAIL, *RULES)}
    figures = rows["as learnt, treenail"]["figures"]
    assert isinstance(figures, dict) and figures["seeds"] == [100 + transfer.OTHER_SEEDS]
    assert rows["as learnt, treenail"]["verdict"]
    assert len(list((tmp_path / "skills").iterdir())) == 1, "what is frozen learns nothing more"
    again = run("transfer", wanted, tmp_path)
    assert again == rows


def test_the_learner_with_other_settings_is_tried_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transfer, "CASES", CASES[:1])
    bold = Wanted(seeds=(100,), episodes=3, baseline_episodes=1, variants=(("bold", "policy.width=2.0"),))
    rows = run("transfer", bold, tmp_path / "transfer")
    assert set(rows) == {f"as learnt, {name}" for name in (TREENAIL, "bold", *RULES)}
    assert rows["as learnt, bold"]["figures"] != rows["as learnt, treenail"]["figures"]
    rows = run("long", bold._replace(tasks=["suite-round"]), tmp_path / "long")
    assert set(rows) == {"suite-round, treenail", "suite-round, bold"}


def test_a_learnt_skill_fits_every_case(tmp_path: Path) -> None:
    job = transfer._learn(LEARNER, 100, 1)
    folder, done = Folder(tmp_path, lambda _: None), work(order(job), lambda _: True)
    assert done.outcome is not None
    folder.keep(job, done.outcome, done.skill)
    for case in CASES:
        if case.task in shipped():
            fits(folder.skill(done.outcome).skill, task_of(case, LEARNER))


def test_a_long_run_says_what_was_kept(tmp_path: Path) -> None:
    rows = run("long", Wanted(tasks=["suite-round"], seeds=(100,), episodes=2), tmp_path)
    assert rows["suite-round, treenail"] | {"missing": []} == {
        "task": "suite-round",
        "method": "treenail",
        "changes_at": None,
        "seeds": [100],
        "good_from": [None],
        "worst": [None],
        "recovered_after": [None],
        "met": False,
        "missing": [],
    }
    assert "never (never)" in (tmp_path / f"{lasting.FILE}.md").read_text()


@pytest.mark.parametrize("task", ablation.TASKS)
def test_every_part_of_the_felt_learner_can_be_left_out(task: str) -> None:
    whole, absent = load(task), []
    made = {}
    for method in ablation.PARTS:
        try:
            made[method.name] = changed(whole, method)
        except DefinitionError as error:
            assert "so already" in str(error)
            absent.append(method.name)
    assert absent == ([] if task == "suite-round-fine" else ["free return"])
    assert whole not in made.values()
    assert len({*map(definition_sha256, made.values())}) == len(ablation.PARTS) - len(absent)
    assert made["no help"].shaping.price_per_n == 0.0
    assert made["force no aim"].shaping == whole.shaping
    assert made["nothing of force"].shaping.price_per_n == 0.0
    assert [name for name, one in made.items() if getattr(one.reward, "force_per_n", 0.0) == 0.0] == [
        "force no aim",
        "nothing of force",
    ]
    assert made["torque as read"].felt.torque == "as_read"
    assert isinstance(made["no model"].learner, QLearning)
    assert made["no model"].shaping.price_per_n == whole.shaping.price_per_n > 0.0


@pytest.mark.parametrize("board", BOARDS)
def test_a_board_says_what_is_wrong_before_it_runs(board: str) -> None:
    with pytest.raises(TreenailError, match="expected"):
        BOARDS[board](Wanted(tasks=["nothing"], methods=["nothing"]))


def test_the_command_has_every_board() -> None:
    assert set(command.BOARDS) == set(BOARDS) - {"learning"}
