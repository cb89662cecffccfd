"""The plan of 5.2.2, the collision limits, and the three readings of the reset vector, in small."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from experiments.lab.contact_states import Sample
from experiments.lab.progress import Lines
from experiments.reproduce import limits, limits_runs, plan, plan_runs, reset_vector, stages
from experiments.reproduce.cache import Cache
from experiments.reproduce.chapter import CannotRun, Comparisons, Table
from experiments.reproduce.classifier_runs import SETTINGS, Source
from experiments.reproduce.classifier_thesis import RHO
from experiments.reproduce.context import Context
from experiments.reproduce.insertion_runs import Gone, Run, insert
from experiments.reproduce.variants import LOOP, Stuck, Tried, Variant, attempt, by_condition, ending, tried
from experiments.reproduce.verdicts import Verdict
from services.classifier.art2 import Art2
from services.wire.definition_file import definition_sha256, load
from services.wire.definition_rules import contradiction


def context(folder: Path, *, kept: bool = False, seeds: tuple[int, ...] = (0,), episodes: int = 2) -> Context:
    said: list[str] = []
    return Context(True, seeds, None, Cache(folder, said.append), Lines(said.append, lambda: 0.0), 1, episodes, kept)


def gone(outcomes: str, force_n: float = 0.5) -> Gone:
    returns = [-15.0 if letter == "i" else -150.0 for letter in outcomes]
    return Gone(returns, [force_n] * len(outcomes), [0.02] * len(outcomes), outcomes, 5)


def test_every_condition_of_the_plan_is_a_task_that_can_be() -> None:
    assert len(plan_runs.CONDITIONS) == 2 * 4 * 2 * 2
    definitions = [plan_runs.definition(condition) for condition in plan_runs.CONDITIONS]
    assert [contradiction(definition) for definition in definitions] == [None] * 32
    assert len({definition_sha256(definition) for definition in definitions}) == 32
    tasks = [limits_runs.definition(condition) for condition in limits_runs.CONDITIONS]
    assert [contradiction(task) for task in tasks] == [None] * 10
    assert len({definition_sha256(task) for task in tasks}) == 10


def test_all_else_is_the_same_throughout_the_plan() -> None:
    """Exactly the same conditions (1790): one learning rate, one discount factor, one vigilance, one task."""
    first, *others = (plan_runs.definition(condition) for condition in plan_runs.CONDITIONS)
    for other in others:
        for part in ("parts", "contact", "wrist", "noise", "start", "reward", "classifier"):
            assert getattr(other, part) == getattr(first, part), part
        assert (other.learner.alpha, other.learner.gamma) == (plan_runs.ALPHA, plan_runs.GAMMA)  # type: ignore[union-attr]


def test_at_its_own_limit_a_task_is_the_shipped_one() -> None:
    for task in limits_runs.TASKS:
        assert definition_sha256(plan_runs.at_limit(load(task), 10.0)) == definition_sha256(load(task))


def test_without_errors_a_task_is_the_shipped_one_with_the_noise_off() -> None:
    condition = limits_runs.Condition(limits_runs.SQUARE, 10.0, errors=False)
    without = load(limits_runs.SQUARE, ("noise.scale=0",))
    assert definition_sha256(limits_runs.definition(condition)) == definition_sha256(without)


def test_a_variant_of_a_shipped_task_is_that_task_s_run() -> None:
    definition = load("chamfered-q-softmax")
    sha256 = definition_sha256(definition)
    run = attempt({sha256: definition}, Variant(sha256, 3, 3))
    whole = insert(Run(definition.name, sha256, 3, 3))
    assert run.gone == Gone(whole.returns, whole.force_n, whole.torque_nm, whole.outcomes, whole.states)
    assert len(run.away_mm) == 3
    inserted = [away for away, letter in zip(run.away_mm, whole.outcomes, strict=True) if letter == "i"]
    assert all(away < 1.0 for away in inserted), "what is in the hole is near its axis"


def test_a_loop_is_two_moves_in_turn_to_the_end() -> None:
    turning = ["+RZ", "-RZ"] * LOOP
    assert ending(7, turning, [3, 0] * LOOP) == Stuck(7, "+RZ -RZ", "3 0", 1.0)
    assert ending(7, ["+X", *turning][:-1], [3] * 2 * LOOP).loop == "+RZ -RZ"
    assert ending(7, [*turning, "-RZ"], [0] * (2 * LOOP + 1)).loop == "", "two of one in a row"
    assert ending(7, turning[: LOOP - 1], [0] * (LOOP - 1)).loop == "", "too short to tell"
    assert ending(7, ["+X", "+RZ"] * LOOP, [None, 4] * LOOP) == Stuck(7, "+RZ +X", "4 None", 0.5)
    assert ending(7, [], []) == Stuck(7, "", "", 0.0)


def test_runs_go_to_their_conditions() -> None:
    runs = [Tried(gone("i" * n), []) if n else None for n in (1, 2, 0, 4, 5, 6)]
    sorted_runs = by_condition(["a", "b"], 3, runs)
    assert [len(run.gone.outcomes) for run in sorted_runs["a"]] == [1, 5]
    assert [len(run.gone.outcomes) for run in sorted_runs["b"]] == [2, 4, 6]


def test_stages_of_a_run_that_is_as_the_thesis_says() -> None:
    run = gone("c" * 12 + "i" * 388)
    run.force_n[:10] = [6.0] * 10
    failed, steady, fallen = stages.stages("some", [Tried(run, [])])
    assert (failed.ours, failed.outcome) == ([80.0], Verdict.MATCHES)
    assert (steady.ours, steady.outcome) == ([10], Verdict.BEATS)
    assert (fallen.ours, fallen.outcome) == ([12.0], Verdict.MATCHES)
    assert stages.stages("some", [Tried(gone("i" * 400), [])])[2].outcome is Verdict.DIFFERS


def test_kept_runs_are_shown_and_none_is_made(tmp_path: Path) -> None:
    with pytest.raises(CannotRun, match="no run of the plan is kept"):
        plan.chapter(context(tmp_path, kept=True))
    with pytest.raises(CannotRun, match="no run of these is kept"):
        limits.chapter(context(tmp_path, kept=True))
    few = [*plan_runs.of_plan((0,), 2)[:2], *plan_runs.of_schedules((0,), 2)[:1]]
    assert None not in tried(context(tmp_path), few)
    before = sorted(tmp_path.iterdir())
    chapter = plan.chapter(context(tmp_path, kept=True, seeds=(0, 1)))
    assert sorted(tmp_path.iterdir()) == before
    table, schedules = (block for block in chapter.blocks if isinstance(block, Table))
    assert [row[4] for row in table.rows] == ["1", "1", *["0"] * 30]
    assert {row[5] for row in table.rows[2:]} == {"not run"}
    assert [row[2] for row in schedules.rows] == ["1", "0"]


def test_the_limits_of_made_up_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def made_up(_: Context, wanted: object) -> list[Tried | None]:
        lost = [Stuck(150, "+RZ -RZ", "3 0", 1.0), Stuck(151, "", "", 0.2)]
        return [Tried(gone("c" * 20 + "i" * 130 + "p" * 2), [5.0] * 152, lost) for _ in limits_runs.CONDITIONS]

    monkeypatch.setattr(limits, "tried", made_up)
    chapter = limits.chapter(context(tmp_path))
    tables = [block for block in chapter.blocks if isinstance(block, Table)]
    assert [row[:2] for row in tables[0].rows][-1] == ("square-q-softmax", "20 N")
    assert tables[-1].rows[0] == ("10 N", "1", "2", "1", "1", "none", "60 % of their last 100 decisions")
    assert [row[0] for row in tables[-1].rows[2:]] == [f"{n} N, no errors of sensor and arm" for n in (10, 20)]
    last = [block for block in chapter.blocks if isinstance(block, Comparisons)][-1]
    assert [row.outcome for row in last.rows] == [Verdict.MATCHES] * 4
    (negative,) = (block for block in chapter.blocks if isinstance(block, Comparisons) and "negative" in block.caption)
    assert {row.outcome for row in negative.rows} == {Verdict.DIFFERS}, "some went in"


def vectors() -> list[Sample]:
    directions = [
        (1.0, 0.0, 1.0),
        (-1.0, 0.0, 1.0),
        (0.0, 1.0, 1.0),
        (0.2, -1.0, 1.0),
        (0.0, 0.0, 1.0),
        (0.9, 0.1, 1.0),
    ]
    return [Sample(force, (0.01 * n, -0.02, 0.003), "") for n, force in enumerate(directions * 3)]


@pytest.mark.parametrize("rho", [0.90, 0.94, 0.99])
def test_the_reading_that_is_used_is_the_network_s_own(rho: float) -> None:
    network = Art2(replace(SETTINGS, rho=rho))
    for sample in vectors():
        network.learn(sample.force_n, sample.torque_nm)
    counted = reset_vector.count(vectors(), reset_vector.Reading("", 18, rho, reset_vector.USED))
    assert counted == network.states > 1


def test_as_printed_no_vigilance_resets_anything() -> None:
    by_rho = {rho: reset_vector.count(vectors(), reset_vector.Reading("", 18, rho, "q of F1")) for rho in (0.5, 0.999)}
    assert by_rho[0.5] == by_rho[0.999]


def test_the_readings_are_compared(tmp_path: Path) -> None:
    source = Source.of([vectors()])
    blocks = reset_vector.readings(context(tmp_path), source, (0.90, 0.99))
    (table,) = (block for block in blocks if isinstance(block, Table))
    assert table.head == (RHO, "q' of F0", "q of F1", "u of F1")
    assert [row[0] for row in table.rows] == ["0.90", "0.99"]
