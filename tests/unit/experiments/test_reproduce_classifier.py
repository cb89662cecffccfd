"""The chapter on the classifier: runs go through the service's network, tables and checks tell right from wrong."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from experiments.lab.contact_states import Sample
from experiments.lab.progress import Reach
from experiments.lab.recordings import FAILURES, DataError
from experiments.reproduce import classifier_figures as figures
from experiments.reproduce import classifier_thesis as thesis
from experiments.reproduce.cache import Cache
from experiments.reproduce.chapter import Chapter, Text
from experiments.reproduce.classifier_counts import first, rises
from experiments.reproduce.classifier_real import DATA, blocks, data_folder, growth, real
from experiments.reproduce.classifier_runs import (
    SETTINGS,
    UNCLASSIFIED,
    Groups,
    Learnt,
    Shown,
    Source,
    in_order,
    learn,
    looked_at,
    part_of,
    settled_at,
)
from experiments.reproduce.classifier_stability import changed, sizes, stability
from experiments.reproduce.classifier_truth import in_words
from experiments.reproduce.context import Context
from experiments.reproduce.verdicts import Verdict


def groups(count: int, size: int = 20) -> Groups:
    """Vectors that point one of four ways, a group each, a little apart."""
    made: Groups = []
    for number in range(count):
        octant = 2 * (number % 4)
        angles = [octant * math.pi / 4 + 0.02 * math.sin(number + index) for index in range(size)]
        made.append(
            [
                Sample((2 * math.cos(angle), 2 * math.sin(angle), -1.0), (0.0, 0.0, 0.0), f"bore-{octant}")
                for angle in angles
            ]
        )
    return made


def shown(source: Source, order: int = 0, presentations: int = 1600, rho: float = 0.97) -> Learnt:
    return learn({source.sha256: source.groups}, Shown(source.sha256, order, presentations, replace(SETTINGS, rho=rho)))


def test_clear_states_are_found_and_kept() -> None:
    source = Source.of(groups(80))
    found = shown(source)
    assert found.sizes == [400, 400, 400, 400]
    assert (found.ari, found.purity, found.ari_side) == (1.0, 1.0, 1.0)
    assert found.ari_feature == 0.0  # one feature only tells nothing
    assert len(found.looks) == len(looked_at(1600)) == 2
    assert UNCLASSIFIED not in found.looks[1]
    assert found == shown(source)


def test_too_little_vigilance_takes_states_together() -> None:
    found = shown(Source.of(groups(80)), rho=0.5)
    assert found.classes < 4
    assert found.ari < 0.7


def test_a_probe_that_fits_no_class_yet_has_none() -> None:
    found = shown(Source.of(groups(4)), presentations=20)
    assert found.classes == 1
    assert set(found.looks[0]) == {0, UNCLASSIFIED}


def test_order_keeps_together_what_came_together() -> None:
    made = groups(10, size=3)
    assert in_order(made, 0, 30) == [sample for group in made for sample in group]
    other = in_order(made, 1, 30)
    assert other != in_order(made, 0, 30)
    assert sorted(other) == sorted(in_order(made, 0, 30))
    assert [other[at : at + 3] in made for at in range(0, 30, 3)] == [True] * 10
    again = in_order(made, 0, 50)
    assert len(again) == 50
    assert again[:30] == in_order(made, 0, 30)
    assert again[30:] != again[:20]


def test_the_first_groups_hold_so_many_vectors() -> None:
    made = groups(5, size=4)
    assert first(made, 8) == made[:2]
    assert first(made, 20) == made


def test_sources_are_named_by_their_content() -> None:
    made = groups(3)
    assert Source.of(made).sha256 == Source.of(groups(3)).sha256
    assert Source.of(made).sha256 != Source.of(made[::-1]).sha256


def test_looks_are_those_of_the_tables() -> None:
    assert looked_at(999) == (1,)
    assert looked_at(20224) == (1, *range(1000, 20001, 1000))


@pytest.mark.parametrize(
    "looks, at",
    [([[1], [1], [1]], 1), ([[1], [2], [2]], 1000), ([[1], [2], [1]], 2000), ([[1], [1], [2]], 2000)],
)
def test_settled_is_the_first_look_without_later_change(looks: list[list[int]], at: int) -> None:
    assert settled_at((1, 1000, 2000), looks) == at


def test_late_changes_are_counted_by_probe() -> None:
    when = (1, 7000, 8000, 9000)
    assert changed(when, [[1, 1, 1], [2, 3, 4], [2, 3, 5], [2, 9, 4]]) == 2
    assert changed(when, [[1, 1, 1], [2, 3, 4], [2, 3, 4], [2, 3, 4]]) == 0


@pytest.mark.parametrize(
    "truth, parts",
    [("bore-2", ("bore", "2")), ("bore-2+mouth-6", ("bore+mouth", "2+6")), ("bore-2+mouth-2", ("bore+mouth", "2"))],
)
def test_parts_of_a_contact_state(truth: str, parts: tuple[str, str]) -> None:
    assert (part_of(truth, 0), part_of(truth, 1)) == parts


def test_the_thesis_tables_have_what_is_printed() -> None:
    assert set(thesis.PROBES) == set(thesis.RHOS) == set(thesis.TABLES)
    assert thesis.classes_of_probes(0.95, 6000) == (4, 5, 6, 1, 7)
    assert thesis.classes_of_probes(0.95, 7000) == (4, 5, 10, 13, 7)
    assert thesis.classes_of_probes(0.94, 13000) == (3, 4, 9, 1, 12)
    assert thesis.classes_of_probes(0.98, 20000) == (4, 5, 13, 19, 6)
    when = looked_at(thesis.LAST)
    settled = {rho: settled_at(when, [thesis.classes_of_probes(rho, at) for at in when]) for rho in thesis.RHOS}
    assert list(settled.values()) == [1000, 8000, 2000, 8000, 14000, 7000, 9000, 1000, 16000, 11000]
    for rho, told in thesis.CLASSES.items():
        assert max(max(row) for row in thesis.PROBES[rho].values()) <= told
    assert (thesis.TABLES[0.90], thesis.TABLES[0.95], thesis.TABLES[0.99]) == ("A.2", "4.3 and A.7", "A.11")


def test_a_rise_is_steepest_at_its_end() -> None:
    assert rises([9, 11, 10, 15, 100])
    assert not rises([9, 11, 8, 15, 100])
    assert not rises([9, 50, 60, 70, 75])
    assert growth({0.99: 104.0, 0.90: 10.0, 0.95: 20.0}) == 10.4


def test_stability_is_judged_over_all_tables() -> None:
    when = looked_at(10000)
    kept = Learnt([5, 5], [[0] * 5] * len(when), 0.5, 0.5, 0.5, 0.5)
    late = Learnt([5, 5], [*[[0] * 5] * (len(when) - 1), [1] * 5], 0.5, 0.5, 0.5, 0.5)
    good, bad = (Chapter(stability({0.94: [run, run], 0.95: [run, run]}, 10000)).comparisons for run in (kept, late))
    assert [row.outcome for row in good] == [Verdict.MATCHES, Verdict.BEATS, Verdict.BEATS]
    assert [row.outcome for row in bad] == [Verdict.DIFFERS] * 3
    # Of Tables A.6 and A.7 the first changes late, as far as presentation 10000 in vectors C and E.
    assert [row.thesis.split(" (")[0] for row in good] == ["at most 7000", "1", "1"]
    assert [row.ours for row in bad] == [[10000.0, 10000.0], [2.0, 2.0], [5.0, 5.0]]


def test_words_on_agreement_follow_the_numbers() -> None:
    words = in_words((0.9, 0.95, 0.99), (0.0, 0.05), np.array([[0.10, 0.30, 0.20], [0.11, 0.31, 0.29]]), 0.05)
    assert "best at \N{GREEK SMALL LETTER RHO} = 0.95 and θ = 0.05 (ARI 0.31)" in words
    assert "from \N{GREEK SMALL LETTER RHO} = 0.95 to 0.99" in words
    assert "matters less than the vigilance: it changes the index by at most 0.09, the vigilance by up to 0.20" in words


def test_figures_are_drawn() -> None:
    classes = {0.90: [9, 10], 0.95: [17, 18], 0.99: [150, 160]}
    assert "a real robot" in figures.classes(classes, thesis.CLASSES, {0.90: 15, 0.99: 150})
    assert "a real robot" not in figures.classes(classes, thesis.CLASSES, {})
    run = Learnt([3] * 150, [], 0.5, 0.5, 0.5, 0.5)
    assert len(sizes({0.90: [run], 0.95: [run]})) == 3
    assert ".31" in figures.agreement((0.9, 0.95), (0.0, 0.05), np.array([[0.1, 0.31], [0.2, 0.25]]))


class Quiet:
    """Hears nothing."""

    def say(self, line: str) -> None:
        """Hear something."""

    def begin(self, what: str, total: int, unit: str, done: int = 0) -> Reach:
        """Hear of work."""
        return lambda count: None


def context(folder: Path, data: Path | None) -> Context:
    return Context(True, (0, 1), data, Cache(folder / "cache", Quiet().say), Quiet(), 1)


def test_without_a_data_set_the_chapter_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(DATA, raising=False)
    assert real(context(tmp_path, None), (0.95,), 100) is None
    _, text = blocks(None)
    assert isinstance(text, Text)
    assert text.text.startswith("Not computed: no data set was given.")
    assert "TREENAIL_DATA" in text.text


def test_the_environment_stands_in_for_the_option(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = tmp_path / "other"
    monkeypatch.setenv(DATA, str(tmp_path))
    assert data_folder(context(tmp_path, None)) == tmp_path
    assert data_folder(context(tmp_path, other)) == other
    monkeypatch.setenv(DATA, str(other))
    with pytest.raises(DataError, match=r"TREENAIL_DATA: expected a folder, got .*other"):
        data_folder(context(tmp_path, None))


def test_real_recordings_are_shown_as_they_are(tmp_path: Path) -> None:
    def execution(label: str, *vectors: str) -> str:
        return label + "\n" + "".join(f"{vectors[index % len(vectors)]}\n" for index in range(15)) + "\n"

    content = execution("normal", "0 0 60 -3 0 0") + execution("collision", "-50 2 3 9 0 1", "0 0 0 0 0 0")
    for name in FAILURES:
        (tmp_path / f"{name}.data").write_text(content, encoding="utf-8")
    found = real(context(tmp_path, tmp_path), (0.90, 0.95, 0.99), 200)
    assert found is not None
    assert [[run.classes for run in runs] for runs in found.runs.values()] == [[2, 2]] * 3
    made = blocks(found)
    words = [block.text for block in made if isinstance(block, Text)]
    assert "All 90 vectors but 21 that are all zero are shown" in words[0]
    assert "names no units" in words[0]
    assert [row.outcome for row in Chapter(made).comparisons] == [Verdict.DIFFERS, Verdict.MATCHES]


def test_a_damaged_data_set_ends_the_chapter(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"lp1\.data: expected a data file, got none"):
        real(context(tmp_path, tmp_path), (0.95,), 100)
