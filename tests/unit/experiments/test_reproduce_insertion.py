"""The chapter on insertions: figures of a run, what is compared, and agreement with true contact states."""

from __future__ import annotations

import hashlib
import os
import re
from pathlib import Path

import pytest
from msgspec.structs import replace

from experiments.reproduce.insertion_compare import NEVER, aims, compare, figures_of
from experiments.reproduce.insertion_exploration import Exploring, WatchedRun, explore
from experiments.reproduce.insertion_runs import Gone, Run, insert
from experiments.reproduce.insertion_thesis import REPORTED, Said
from experiments.reproduce.verdicts import Verdict
from services.wire.definition import EpsilonGreedy, Greedy
from services.wire.definition_file import definition_sha256, load, shipped
from services.wire.errors import TreenailError


def gone(outcomes: str, last_return: float = -15.0) -> Gone:
    returns = [last_return if letter == "i" else -150.0 for letter in outcomes]
    return Gone(returns, [0.25] * len(outcomes), [0.02] * len(outcomes), outcomes, 5)


def test_figures_of_a_run() -> None:
    figures = figures_of(gone("c" * 7 + "i" * 293 + "c" + "i" * 99))
    assert figures.steady == 5, "two failures in a hundred are steady"
    assert figures.collisions == 8
    assert figures.collisions_after == 3
    assert figures.longest == 293
    assert figures.success == 0.99
    assert figures.force_n == 0.25


def test_never_steady_is_never_and_has_no_time_after_it() -> None:
    figures = figures_of(gone("ci" * 100))
    assert figures.steady == NEVER
    assert figures.collisions == 100
    assert figures.collisions_after == NEVER, "none is no credit to a run that never was steady"


def test_the_end_of_a_run_is_its_last_hundred_episodes() -> None:
    run = gone("i" * 400)
    run.force_n[:] = [2.0] * 300 + [0.5] * 100
    assert figures_of(run).force_end_n == 0.5


def outcomes(name: str, *runs: Gone) -> dict[str, Verdict]:
    (reported,) = (each for each in REPORTED if each.name == name)
    rows = compare(reported, [figures_of(run) for run in runs])
    return {row.what.removeprefix(f"{name}: "): row.outcome for row in rows}


def test_verdicts() -> None:
    good = outcomes("chamfered-q-softmax", gone("c" * 7 + "i" * 393))
    assert good["steady from episode"] is Verdict.BEATS
    assert good["return, last quarter"] is Verdict.MATCHES
    assert good["mean force, last quarter"] is Verdict.MATCHES
    assert set(outcomes("chamfered-q-softmax", gone("c" * 300 + "ici" * 50)).values()) >= {Verdict.DIFFERS}


def test_a_run_that_never_was_steady_matches_nothing_that_came_after_it() -> None:
    (reported,) = (each for each in REPORTED if each.name == "chamfered-q-softmax")
    rows = compare(reported, [figures_of(gone("c" * 300 + "ici" * 50))])
    steady, after = (row for row in rows if "steady" in row.what)
    assert steady.ours_shown == after.ours_shown == "never"
    assert steady.outcome is after.outcome is Verdict.DIFFERS
    assert "Never steady in 1 of 1 seeds." in steady.note


def test_sarsa_presses_harder_than_the_thesis_says() -> None:
    assert outcomes("chamfered-sarsa-softmax", gone("i" * 400))["mean force, last quarter"] is Verdict.DIFFERS


def test_another_task_is_neither_better_nor_worse() -> None:
    assert set(outcomes("initial", gone("i" * 400, last_return=-1.0)).values()) == {Verdict.APART}


def test_our_own_aims_are_no_part_of_the_comparison() -> None:
    figures = [[figures_of(gone("i" * 400))] for _ in REPORTED]
    table = aims(REPORTED, figures)
    assert [row[0] for row in table.rows] == [each.name for each in REPORTED if each.success_aim is not None]
    assert {row[-1] for row in table.rows} == {"met"}
    assert not any("success" in row.what for each in REPORTED for row in compare(each, figures[0]))


THESIS = "TREENAIL_THESIS"
"""Names the file with the thesis's text, which is not ours to give away."""


@pytest.mark.parametrize("name", [each.name for each in REPORTED if each.said])
def test_every_number_of_the_thesis_stands_in_the_line_that_is_named(name: str) -> None:
    (reported,) = (each for each in REPORTED if each.name == name)
    path = os.environ.get(THESIS)
    if not path:
        pytest.skip(f"{THESIS} does not name the thesis's text")
    lines = Path(path).read_text(encoding="utf-8").split("\n")
    for said in reported.said:
        line = lines[said.line - 1]
        assert said.printed in line, f"line {said.line} does not say {said.printed!r}"
        assert hashlib.sha256(line.encode()).hexdigest()[:16] == said.line_sha256, f"line {said.line} is another"


@pytest.mark.parametrize("said", [said for each in REPORTED for said in each.said], ids=lambda said: said.printed)
def test_a_number_is_the_one_that_its_words_say(said: Said) -> None:
    """A torque is printed ten times as large, and a return without its sign once."""
    printed = [abs(float(text)) for text in re.findall(r"\d+(?:\.\d+)?", said.printed)]
    counted = {"seven": 7, "Only one": 1, "during episode": 1, "249, 435": 7}
    printed += [float(number) for text, number in counted.items() if text in said.printed]
    expected = abs(said.value)
    middle = sum(printed[:2]) / 2
    assert any(expected == pytest.approx(number) for value in printed for number in (value, value / 10)) or (
        expected == pytest.approx(middle)
    ), said


def test_every_experiment_of_the_thesis_has_a_definition() -> None:
    assert {one.name for one in REPORTED} <= set(shipped())


def test_a_run_of_another_definition_is_refused() -> None:
    with pytest.raises(TreenailError, match="expected definition"):
        insert(Run("chamfered-q-softmax", "0" * 64, 0, 1))


def test_a_run_knows_how_its_classes_agree_with_the_truth() -> None:
    name = "chamfered-q-softmax"
    run = insert(Run(name, definition_sha256(load(name)), 1, 5))
    assert len(run.returns) == len(run.outcomes) == 5
    (block,) = run.blocks
    assert block.decisions > 100
    assert 0 < block.purity <= 1
    assert block.entropy_bit >= 0
    assert block.states <= run.states


def test_only_a_move_that_is_not_the_best_known_counts_as_exploring() -> None:
    definition = load("chamfered-q-egreedy")
    greedy = WatchedRun(replace(definition, policy=Greedy()), 0)
    assert sum(summary.decisions for summary in greedy.episodes(2)) > 20
    assert not greedy.explored
    random = WatchedRun(replace(definition, policy=EpsilonGreedy(epsilon=1.0)), 0)
    assert sum(summary.decisions for summary in random.episodes(1)) > 1
    assert random.explored


def test_what_exploring_costs_is_measured_with_the_table_that_was_learnt() -> None:
    name = "chamfered-q-egreedy"
    found = explore(Exploring(name, definition_sha256(load(name)), 1, 8, 2))
    assert 0 <= found.failures_after_exploring <= found.failures <= 4
    assert found.success == 1 - found.failures / 4
    assert found.greedy_success in (0.0, 0.5, 1.0)
