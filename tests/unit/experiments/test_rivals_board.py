"""The board of earlier controllers: every one of them says what it was told, and is tried where it never learnt."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from experiments.evaluate.controllers import ACTION, RULES
from experiments.evaluate.frozen import FrozenSkill
from experiments.lab.in_process import InProcessRun
from experiments.lab.progress import Lines
from experiments.leaderboard import rivals
from experiments.leaderboard.boards import BOARDS, Wanted
from experiments.leaderboard.folder import Folder
from experiments.leaderboard.jobs import Done, Job, Order, code_of, key, work
from experiments.leaderboard.methods import METHODS, RIVALS, TREENAIL, changed, methods
from experiments.leaderboard.told import TOLD
from experiments.rivals.taught import TAUGHT
from services.task.insertion import Insertion
from services.wire.definition import Definition
from services.wire.definition_file import load
from services.wire.errors import TreenailError
from services.wire.messages import Observation

ROUND, SQUARE = load("suite-round"), load("suite-square")
pytest.importorskip("sklearn", reason="scikit-learn, of the extra rivals, is not installed")


def here(
    work: Callable[[Order, Callable[[int], bool]], Done],
    keys: Sequence[Order],
    name: Callable[[Order], str],
    advanced: Callable[[int, int], None],
) -> Iterator[tuple[int, Done]]:
    for index, given in enumerate(keys):
        yield index, work(given, lambda _: True)


def test_every_rival_says_what_it_was_told() -> None:
    assert {method.name for method in (*METHODS, *RIVALS)} == set(TOLD)
    assert {method.name for method in RIVALS if method.kind == "taught"} == set(TAUGHT)
    beside = {TREENAIL, "table", *RULES}
    assert {method.name for method in rivals.methods(None)} == {*beside, *(method.name for method in RIVALS)}
    with pytest.raises(TreenailError, match=r"--methods: expected some of .*asada"):
        rivals.methods(["nothing"])


def test_rivals_are_on_the_leaderboard_only_where_they_are_named() -> None:
    assert not {method.name for method in methods(None)} & {method.name for method in RIVALS}
    assert {method.name for method in methods(["som", "asada"])} == {"som", "asada", *RULES}


@pytest.mark.parametrize("task", [ROUND, SQUARE], ids=lambda task: task.name)
def test_one_start_is_the_same_in_every_episode(task: Definition) -> None:
    def starts(definition: Definition) -> set[tuple[float, ...]]:
        homes = [Insertion(definition, "r", 100).home(episode, 0) for episode in range(5)]
        return {(home.x_mm, home.y_mm, home.rx_deg, home.ry_deg, home.rz_deg) for home in homes}

    (start,) = starts(rivals.at_one_start(task))
    assert start == rivals.ONE_START["round" if task.parts.shape == "round" else "other"]
    assert len(starts(task)) == 5


def test_what_is_taught_elsewhere_is_another_job_and_a_plug_ins_code_counts() -> None:
    job = Job("t", "asada", "taught", ROUND, 1, 1)
    elsewhere = Job("t", "asada", "taught", ROUND, 1, 1, taught_on=rivals.at_one_start(ROUND))
    assert key(job) != key(elsewhere)
    assert key(job) == key(Job("t", "asada", "taught", load("suite-round", ["policy.kind=greedy"]), 1, 1))
    (som,) = (method for method in RIVALS if method.name == "som")
    assert code_of(Job("t", "som", "learn", changed(ROUND, som), 1, 1)) != code_of(Job("t", "x", "learn", ROUND, 1, 1))
    told = work(Order(Job("t", "nobody", "taught", ROUND, 1, 1), code_of(job)), lambda _: True)
    assert told.failure == "controller: expected one of asada, howarth, artmap, art-normals, got nobody"


def test_frozen_map_with_position_hears_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    (method,) = (method for method in RIVALS if method.name == "som-position")
    run = InProcessRun(changed(ROUND, method), 3)
    list(run.episodes(2))
    frozen = FrozenSkill(run.learnt(), changed(ROUND, method), 3)
    heard: list[int | None] = []
    monkeypatch.setattr(frozen._classifier, "begin", lambda: heard.append(None))
    monkeypatch.setattr(frozen._classifier, "took", heard.append)
    for previous in (None, ACTION["+X"]):
        frozen.decide(
            Observation(
                run="r",
                episode=0,
                step=1,
                decision=0,
                force_n=(0.0, 0.0, -1.0),
                torque_nm=(0.0, 0.1, 0.0),
                previous_action=previous,
            )
        )
    assert heard == [None, ACTION["+X"]]


def test_the_page_has_both_questions(tmp_path: Path) -> None:
    wanted = Wanted(tasks=["suite-round"], methods=["som", "artmap"], seeds=(100,), episodes=2, baseline_episodes=1)
    folder = Folder(tmp_path, lambda _: None)
    page, failures = BOARDS["rivals"](wanted)(folder, here, Lines(lambda _: None, lambda: 0.0))
    assert failures == 0
    names = {"som", "artmap", TREENAIL, *RULES}
    rows = json.loads((tmp_path / "rivals.json").read_text())["rows"]
    assert {(row["starts"], row["method"]) for row in rows} == {
        (starts, name) for starts in ("random", "unseen") for name in names
    }
    assert all(row["figures"]["seeds"] == [1100 if row["starts"] == "unseen" else 100] for row in rows)
    assert {row["figures"]["episodes"] for row in rows if row["method"] == "som"} == {1, 2}
    text = page.read_text()
    assert "`treenail leaderboard --rivals` makes this page" in text
    assert "| `som` | Cervera" in text and "the moves commanded since" not in text
    assert text.count("`treenail`: ") <= 4 and "From nothing, " in text and "Unseen, " in text


def test_the_page_of_nothing_says_what_is_not_there(tmp_path: Path) -> None:
    wanted = Wanted(tasks=["suite-round"], methods=["artmap"], seeds=(100, 101), episodes=1, baseline_episodes=1)
    folder = Folder(tmp_path, lambda _: None)
    page, _ = BOARDS["rivals"](wanted)(folder, None, Lines(lambda _: None, lambda: 0.0))
    assert "- `artmap`: 2 of 2 seeds not run yet" in page.read_text()
