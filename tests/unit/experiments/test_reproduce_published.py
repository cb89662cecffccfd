"""The report's sections as pages of Markdown: all numbers, the command that makes them, drawings that stand alone."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from experiments.reproduce import published, report
from experiments.reproduce.chapter import (
    Block,
    Chapter,
    Comparison,
    Comparisons,
    Figure,
    Heading,
    Section,
    Table,
    Text,
)
from experiments.reproduce.context import Context
from experiments.reproduce.figures import drawing, svg
from experiments.reproduce.page import Done
from experiments.reproduce.verdicts import Verdict, among

FACTS = {"machine": "a fast one", "seeds": "3: 0 to 2", "sections": "made-up", "took": "2 s"}


def drawn(lines: int = 1) -> str:
    with drawing() as (figure, ((axes,),)):
        for line in range(lines):
            axes.plot(range(0, 5000), [line * n % 97 for n in range(5000)], label="a")
        return svg(figure)


def section(*blocks: Block) -> Section:
    return Section("made-up", "A section that is made up", lambda _context: Chapter(blocks))


def page_of(*blocks: Block) -> dict[str, str]:
    done = Done(section(*blocks), Chapter(blocks))
    return published.pages(FACTS, [done], ["--seeds", "3", "--pages", "docs", "--kept"])


def test_a_page_has_all_that_the_section_has() -> None:
    files = page_of(
        Text("Some words."),
        Heading("A part"),
        Table("4.2", "Numbers.", ("a", "b"), [("1 | 2", "3\n4")]),
        Comparisons([Comparison("answer", "42 (1234)", [1.0, 2.0], among(42), "it was another question", "N")]),
        Figure("4.1", "A drawing.", drawn()),
    )
    page = files["made-up.md"]
    assert page.startswith("# A section that is made up\n\nMade by `treenail reproduce --only made-up --seeds 3`.\n")
    for part in (
        "- machine: a fast one",
        "## A part",
        "Table 4.2. Numbers.\n\n| a | b |\n| --- | --- |\n| 1 \\| 2 | 3 4 |",
        "| answer | 42 (1234) | 1.5 N (1 to 2) | differs | it was another question |",
        "![A drawing.](images/made-up-1.svg)\n\nFig. 4.1. A drawing.",
        "Compared with the thesis: 1 differs.",
    ):
        assert part in page, part
    assert "took" not in page, "the same run gives the same page"
    assert "sections" not in page


def test_a_drawing_stands_alone() -> None:
    image = page_of(Figure("", "A drawing.", drawn()))["images/made-up-1.svg"]
    assert ElementTree.fromstring(image).tag == "{http://www.w3.org/2000/svg}svg"
    assert "currentColor" not in image


def test_a_large_drawing_stays_in_the_report() -> None:
    files = page_of(Figure("", "Large.", drawn(20)), Figure("", "Small.", drawn()))
    assert set(files) == {"made-up.md", "images/made-up-1.svg"}
    assert "![Large.]" not in files["made-up.md"]
    assert "Of the drawings 1 stand in the report alone" in files["made-up.md"]


def test_what_could_not_run_says_so() -> None:
    files = published.pages(FACTS, [Done(section(), None, "no data")], [])
    assert files == {"made-up.md": files["made-up.md"]}
    assert files["made-up.md"].endswith("\n\nCould not run: no data\n")


def test_the_command_is_what_makes_the_numbers() -> None:
    words = ["--only", "learners", "plan", "--seeds", "2", "--out=r", "--jobs", "1", "--quick", "--data", "a b"]
    assert published.command("plan", words) == "treenail reproduce --only plan --seeds 2 --quick --data 'a b'"
    assert published.command("plan", ["--quick", "--only", "plan"]) == "treenail reproduce --only plan --quick"


def test_the_report_writes_its_pages(tmp_path: Path) -> None:
    def fine(context: Context) -> Chapter:
        kept = context.pieces_kept("pieces", [{"version": 1}], str, str)
        return Chapter((Comparisons([Comparison("kept", "1", str(len(kept)), Verdict.MATCHES)]),))

    wanted = report.Wanted(
        True, (0,), None, tmp_path / "out", None, 1, kept=True, pages=tmp_path / "docs", words=["--quick", "--kept"]
    )
    report.make(wanted, (Section("fine", "A fine section", fine),))
    page = (tmp_path / "docs" / "fine.md").read_text()
    assert "treenail reproduce --only fine --quick`" in page
    assert "| kept | 1 | 1 | matches |  |" in page
