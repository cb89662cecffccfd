"""What a comparison with the thesis comes to, and how it is shown."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from experiments.reproduce.chapter import Comparison, Table, in_all_seeds
from experiments.reproduce.verdicts import Rule, Verdict, always, among, at_least, at_most, interval, near

MATCHES, BEATS, DIFFERS = Verdict.MATCHES, Verdict.BEATS, Verdict.DIFFERS


@pytest.mark.parametrize(
    ("rule", "values", "verdict"),
    [
        (near(10, 2), [7, 12, 30], MATCHES),
        (near(10, 2), [12.1], DIFFERS),
        (near(10, 2, "higher"), [12.1], BEATS),
        (near(10, 2, "higher"), [7.9], DIFFERS),
        (near(10, 2, "lower"), [7.9], BEATS),
        (among(11), [9, 15], MATCHES),
        (among(11), [11, 11], MATCHES),
        (among(11), [12, 15], DIFFERS),
        (among(11, "lower"), [12, 15], DIFFERS),
        (among(11, "lower"), [9, 10], BEATS),
        (among(-131, "higher"), [-100, -90], BEATS),
        (at_most(5), [5], MATCHES),
        (at_most(5), [5.1], DIFFERS),
        (at_most(5, beats_at=2), [2], BEATS),
        (at_least(0.9), [0.9], MATCHES),
        (at_least(0.9), [0.8], DIFFERS),
        (at_least(0.9, beats_at=1.0), [1.0], BEATS),
        (always(8), [8, 8], MATCHES),
        (always(8), [8, 7], DIFFERS),
    ],
)
def test_rules(rule: Rule, values: Sequence[float], verdict: Verdict) -> None:
    assert rule(values) is verdict


def test_the_interval_leaves_out_one_seed_in_twenty_on_each_side() -> None:
    assert interval([3.0, 1.0, 2.0]) == (1.0, 2.0, 3.0)
    assert interval(range(101)) == (5.0, 50.0, 95.0)
    with pytest.raises(ValueError, match="expected one or more"):
        interval([])


def test_values_are_shown_with_their_interval_and_unit() -> None:
    assert Comparison("falls", "11", [9.0, 11.0, 15.0], among(11), "why", "N").ours_shown == "11 N (9 to 15)"
    assert Comparison("falls", "11", [-14.0, -14.0], among(-14), "why").ours_shown == "-14"
    assert Comparison("force", "0.33", [0.12345], near(0.33, 0.3), "why").ours_shown == "0.123"


def test_why_is_shown_only_where_it_differs_and_a_note_always() -> None:
    differs = Comparison("falls", "11", [12.0], among(11), "bad luck", note="one seed")
    matches = Comparison("falls", "11", [11.0], among(11), "bad luck", note="one seed")
    assert (differs.outcome, differs.remarks) == (DIFFERS, ("one seed", "bad luck"))
    assert (matches.outcome, matches.remarks) == (MATCHES, ("one seed",))


def test_a_comparison_that_can_differ_has_to_say_why() -> None:
    with pytest.raises(ValueError, match="a sentence why"):
        Comparison("falls", "11", [11.0], among(11))
    with pytest.raises(ValueError, match="a sentence why"):
        Comparison("path", "edge", "another", DIFFERS)
    with pytest.raises(ValueError, match="expected a verdict"):
        Comparison("path", "edge", "another", among(11), "why")
    with pytest.raises(ValueError, match="got nothing"):
        Comparison("falls", "11", [], among(11), "why")
    assert Comparison("path", "edge", "edge", MATCHES).outcome is MATCHES


def test_a_statement_holds_when_it_holds_for_every_seed() -> None:
    assert in_all_seeds("path", "edge", [True, True], "why").outcome is MATCHES
    missed = in_all_seeds("path", "edge", [True, False], "why")
    assert (missed.outcome, missed.ours_shown, missed.remarks) == (DIFFERS, "1 of 2 seeds", ("why",))


def test_a_ragged_table_is_refused() -> None:
    with pytest.raises(ValueError, match="expected 2 cells"):
        Table("4.1", "states", ("state", "move"), [("1", "E"), ("2",)])
