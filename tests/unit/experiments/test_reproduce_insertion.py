"""The chapter on insertions: figures of a run, what is compared, and agreement with true contact states."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from experiments.reproduce.insertion_compare import compare, figures_of
from experiments.reproduce.insertion_exploration import Exploring, WatchedRun, explore
from experiments.reproduce.insertion_runs import Gone, Run, insert
from experiments.reproduce.insertion_thesis import REPORTED
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


def test_a_run_that_is_never_steady_counts_with_its_length() -> None:
    figures = figures_of(gone("ci" * 100))
    assert figures.steady == 200
    assert figures.collisions_after == 0


def test_verdicts() -> None:
    (reported,) = (one for one in REPORTED if one.name == "chamfered-q-softmax")
    good = {row.what: row.outcome for row in compare(reported, [figures_of(gone("c" * 7 + "i" * 393))], 400)}
    assert good["chamfered-q-softmax: steady from episode"] is Verdict.BEATS
    assert good["chamfered-q-softmax: return, last quarter"] is Verdict.MATCHES
    assert good["chamfered-q-softmax: mean force, last quarter"] is Verdict.MATCHES
    bad = compare(reported, [figures_of(gone("c" * 300 + "ici" * 50))], 450)
    missed = ("steady from episode", "return, last quarter", "success, last quarter")
    assert [row.outcome for row in bad if row.what.endswith(missed)] == [Verdict.DIFFERS] * 3
    assert "Never steady in 1 of 1 seeds." in bad[0].note


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
