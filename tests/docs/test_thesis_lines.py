"""What is quoted of the thesis stands in the line that is named: numbers of pages, of definitions, and whole tables.

The thesis is not ours to give away. ``tests/golden/thesis_lines.json`` has of each line that is named somewhere a hash
and the few words that say its numbers; where ``TREENAIL_THESIS`` names the text, it is held against that.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from experiments.lab.recordings import THESIS_VECTORS
from experiments.reproduce import classifier_thesis, learner_cliff, learner_maze, uncertainty
from experiments.reproduce.insertion_thesis import REPORTED
from experiments.reproduce.learner_runs import KINDS
from services.wire.definition_file import load

ROOT = Path(__file__).parents[2]
LINES: dict[str, dict[str, object]] = json.loads((ROOT / "tests" / "golden" / "thesis_lines.json").read_text())
PAGES = [
    ROOT / "docs" / "thesis.md",
    *sorted((ROOT / "docs" / "experiments").glob("*.md")),
    *sorted((ROOT / "experiments" / "reproduce").glob("*.py")),
]
NAMED = re.compile(r"\(((?:\d{4}, )*\d{4})(?:[,;] [^()]*)?\)")
"""A line, or several, in brackets; words may follow."""
LAST = 3538
TABLES = {
    "4.1": (1410, 1428, "59bdca169ab41247"),
    "A.1": (2435, 2453, "932493cfc09590fa"),
    "4.2": (1502, 1520, "0c6762d43c41082e"),
    "5.1": (1723, 1730, "029e6e895f193ecb"),
    "5.2": (1734, 1741, "2c1cf270766207a6"),
    "5.3": (1745, 1752, "18656515315300a4"),
    "A.2": (2464, 2486, "61028eb6f6f0f56c"),
    "A.3": (2495, 2517, "96019392d0f08cf1"),
    "A.4": (2526, 2548, "a481960a4ddc9437"),
    "A.5": (2557, 2579, "6b064799eb1d9b1c"),
    "A.6": (2588, 2610, "9cf8a71c7e601b8a"),
    "A.7": (2619, 2641, "fb57cc8e1501b96b"),
    "A.8": (2650, 2672, "f5d5d1e8a991fb95"),
    "A.9": (2681, 2703, "139d8eb6246a5e3e"),
    "A.10": (2712, 2734, "6f0e854423dd0c43"),
    "A.11": (2743, 2765, "3d79b2d4488fa9b2"),
}
"""First and last line of a table, and the hash of all between them."""
SETTINGS = [
    ("initial", "limits.collision_force_n", 5.0, 1913),
    ("initial", "moves.actions", 5, 1872),
    ("initial", "policy.epsilon", 0.1, 1876),
    ("initial", "episodes", 500, 1874),
    ("chamfered-q-softmax", "start.x_mm", 1.6, 1934),
    ("chamfered-q-softmax", "start.y_mm", -2.2, 1934),
    ("chamfered-q-softmax", "start.rx_deg", 1.8, 1935),
    ("chamfered-q-softmax", "start.ry_deg", 0.4, 1935),
    ("chamfered-q-softmax", "moves.lateral_mm", 0.2, 1936),
    ("chamfered-q-softmax", "moves.rotation_deg", 0.2, 1936),
    ("chamfered-q-softmax", "limits.collision_force_n", 10.0, 2849),
    ("chamfered-q-softmax", "reward.collision", -100.0, 2199),
    ("chamfered-q-egreedy", "policy.epsilon", 0.1, 2872),
    ("chamferless-q-softmax", "limits.no_progress_moves", 100, 2199),
    ("chamferless-q-softmax", "reward.no_progress", -50.0, 2199),
    ("square-q-softmax", "start.x_mm", -0.6, 2159),
    ("square-q-softmax", "start.y_mm", 0.2, 2159),
    ("square-q-softmax", "start.rx_deg", -1.8, 2160),
    ("square-q-softmax", "start.ry_deg", 1.4, 2160),
    ("square-q-softmax", "start.rz_deg", -0.9, 2160),
    ("square-q-softmax", "moves.lateral_mm", 0.1, 2161),
    ("square-q-softmax", "moves.insertion_mm", 0.2, 2162),
    ("square-q-softmax", "reward.collision", -200.0, 2163),
    ("square-q-softmax", "reward.no_progress", -50.0, 2164),
    ("square-q-softmax", "limits.no_progress_moves", 100, 2164),
    ("square-q-softmax", "episodes", 1800, 2155),
    ("paper2-random-start", "parts.clearance_mm", 0.2, 3292),
    ("paper2-random-start", "reward.fell_by", 0.5, 3292),
    ("paper2-random-start", "reward.rose_by", 0.2, 3292),
    ("paper2-random-start", "classifier.rho", 0.95, 3292),
    ("paper2-random-start", "reward.collision", -200.0, 3299),
]
"""What the thesis says of a task: definition, key, value, line."""
MEASURED = [
    (learner_cliff.FALLS["q_learning"], 1498),
    (learner_cliff.FALLS["sarsa"], 1498),
    (learner_cliff.STABLE["sarsa"], 1457),
    (learner_cliff.STABLE["q_learning"], 1483),
    (learner_cliff.LOWEST["q_learning"], 1483),
    (learner_cliff.LOWEST["sarsa"], 1483),
    (THESIS_VECTORS, 1559),
    (classifier_thesis.CLASSES[0.90], 1653),
    (classifier_thesis.CLASSES[0.99], 1653),
    (classifier_thesis.CLASSES[0.93], 1655),
    (classifier_thesis.CLASSES[0.94], 1655),
    (uncertainty.thesis().sensor["force_error_n"], 1826),
    (uncertainty.thesis().sensor["torque_error"], 1826),
    (uncertainty.thesis().sensor["torque_error_filtered"], 1826),
]
"""What chapters 4 and 5 found: value, line."""


@pytest.fixture(scope="module")
def text() -> Sequence[str]:
    """The thesis's lines."""
    path = os.environ.get("TREENAIL_THESIS")
    if not path:
        pytest.skip("TREENAIL_THESIS does not name the thesis's text")
    return Path(path).read_text(encoding="utf-8").split("\n")


def named(content: str) -> set[str]:
    """Return the lines that a page names."""
    numbers = {number for group in NAMED.findall(content) for number in group.split(", ")}
    return {number for number in numbers if 1000 <= int(number) <= LAST}


def test_lines_are_seen() -> None:
    seen = named(
        "seven (2229), twice (2100, 2102), and (2014; 2294 says 200) or (3041, as printed); not (0006) or (270)"
    )
    assert seen == {"2229", "2100", "2102", "2014", "3041"}


def test_every_line_that_is_named_is_pinned() -> None:
    pinned = {page.name: named(page.read_text(encoding="utf-8")) - LINES.keys() for page in PAGES}
    assert {page: lines for page, lines in pinned.items() if lines} == {}
    assert {str(said.line) for each in REPORTED for said in each.said} - LINES.keys() == set()
    assert {str(line) for *_, line in (*SETTINGS, *MEASURED)} - LINES.keys() == set()


def test_every_line_says_what_is_quoted_of_it(text: Sequence[str]) -> None:
    for number, pin in LINES.items():
        line, says = text[int(number) - 1], pin["says"]
        assert isinstance(says, list)
        assert hashlib.sha256(line.encode()).hexdigest()[:16] == pin["sha256"], f"line {number} is another"
        assert [words for words in says if words not in line] == [], f"line {number}"


@pytest.mark.parametrize(("name", "key", "value", "line"), SETTINGS)
def test_a_definition_is_as_the_thesis_says(name: str, key: str, value: float, line: int) -> None:
    node: object = load(name)
    for part in key.split("."):
        node = getattr(node, part)
    assert node == value
    # A part of 1 is printed in percent.
    assert {abs(value), 100 * abs(value)} & printed(line)


@pytest.mark.parametrize(("value", "line"), MEASURED)
def test_what_was_found_is_as_the_thesis_says(value: float, line: int) -> None:
    assert abs(value) in printed(line)


def printed(line: int) -> set[float]:
    """Return the numbers, without sign, in the words that a line is quoted with."""
    says = LINES[str(line)]["says"]
    assert isinstance(says, list)
    return {abs(float(number)) for number in re.findall(r"\d+(?:\.\d+)?", " ".join(says))}


def rows(text: Sequence[str], table: str) -> list[list[str]]:
    """Return the rows of a table that begin with a number; the table has to be the one that was read."""
    first, last, sha256 = TABLES[table]
    block = text[first - 1 : last]
    assert hashlib.sha256("\n".join(block).encode()).hexdigest()[:16] == sha256, f"table {table} is another"
    return [line.split("\t") for line in block if line[:1].isdigit()]


@pytest.mark.parametrize("rho", classifier_thesis.RHOS)
def test_classes_of_the_probes_are_as_printed(text: Sequence[str], rho: float) -> None:
    table = classifier_thesis.TABLES[rho].rpartition(" ")[2]
    printed = {int(cells[0]): tuple(map(int, cells[1:])) for cells in rows(text, table)}
    assert set(printed) == {1, *range(1000, classifier_thesis.LAST + 1, 1000)}
    assert printed == {shown: classifier_thesis.classes_of_probes(rho, shown) for shown in printed}


def test_learnt_policies_are_as_printed(text: Sequence[str]) -> None:
    for kind in KINDS:
        columns = list(zip(*(cells[1:8] for cells in rows(text, learner_maze.NUMBERS[kind][2])), strict=True))
        assert ["".join(column) for column in columns] == list(learner_maze.THESIS[kind])
    for kind, column in (("sarsa", 1), ("q_learning", 3)):
        assert "".join(cells[column] for cells in rows(text, "4.2")) == learner_cliff.THESIS[kind]


def test_what_a_path_needs_is_as_printed(text: Sequence[str]) -> None:
    """Column "Optimal policy" of the maze, "Safe" and "Optimal" of the cliff; a dash where nothing is needed."""

    def needed(table: str, column: int) -> dict[int, str]:
        return {int(cells[0]): cells[column] for cells in rows(text, table) if cells[column] in "NESW"}

    assert needed("4.1", 8) == needed("A.1", 8) == learner_maze.OPTIMAL
    assert needed("4.2", 2) == learner_cliff.NEEDED["sarsa"]
    assert needed("4.2", 4) == learner_cliff.NEEDED["q_learning"]


@pytest.mark.parametrize("axis", "XYZ")
def test_the_arm_s_motions_are_as_printed(text: Sequence[str], axis: str) -> None:
    printed = [[float(cell) for cell in cells[1:]] for cells in rows(text, f"5.{'XYZ'.index(axis) + 1}")]
    motion = uncertainty.thesis().motion
    assert [row[:3] for row in printed] == motion[f"-{axis}"].tolist()
    assert [row[3:] for row in printed] == motion[f"+{axis}"].tolist()
