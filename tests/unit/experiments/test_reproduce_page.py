"""The page is one file that needs nothing else, well nested, with every name in it given once."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import numpy as np
import pytest

from experiments.reproduce import figures, page
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
from experiments.reproduce.page import Done
from experiments.reproduce.verdicts import Verdict, among

VOID = {"meta", "br", "hr", "img", "link", "input"}


class Nesting(HTMLParser):
    """Checks that what is opened is closed in turn, and gathers names, links and attributes."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.names: list[str] = []
        self.links: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.tags: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attrs:
            self.attributes.append((name, value or ""))
            if name == "id":
                self.names.append(value or "")
            if name == "href":
                self.links.append(value or "")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def drawn() -> str:
    with figures.drawing() as (figure, ((axes,),)):
        returns = np.array([[-5.123456, -4.0, -3.0], [-5.5, -4.5, -2.0]])
        figures.band(axes, [1.0, 2.0, 3.0], returns, figures.BLUE, "μ = 0.001")
        axes.set(xlabel="episode", ylabel="return", ylim=(-6, 0))
        axes.legend()
        return figures.svg(figure)


def a_chapter() -> Chapter:
    blocks: tuple[Block, ...] = (
        Heading("The first & part"),
        Text("A text with <b>no mark-up</b>, see -14 of 2026-01-02."),
        Figure("4.14", 'curves "of" the return', drawn()),
        Figure("", "another of our own", drawn()),
        Table("4.1", "moves", ("state", "move"), [("1", "E")]),
        Comparisons(
            (
                Comparison("falls", "11", [9.0, 15.0], among(11), "not shown"),
                Comparison("path", "edge", "another <path>", Verdict.DIFFERS, "squares look alike"),
            )
        ),
    )
    return Chapter(blocks)


def fail(context: Context) -> Chapter:
    raise AssertionError


def rendered(quick: bool = False) -> str:
    done = [
        Done(Section("learners", "Learners", fail), a_chapter(), seconds=1.0),
        Done(Section("classifier", "Classifier", fail), None, "no data set <here>"),
    ]
    return page.render("A report", {"machine": "a <machine>"}, done, quick)


def parsed(text: str) -> Nesting:
    nesting = Nesting()
    nesting.feed(text)
    nesting.close()
    return nesting


def test_it_is_well_nested_and_every_name_is_given_once_and_every_link_leads_somewhere() -> None:
    nesting = parsed(rendered())
    assert nesting.open == []
    assert len(set(nesting.names)) == len(nesting.names)
    assert {"summary", "learners", "classifier", "learners-the-first-part"} <= set(nesting.names)
    assert nesting.links
    assert all(link.startswith("#") and link[1:] in nesting.names for link in nesting.links)


def test_it_needs_nothing_beside_it() -> None:
    text = rendered()
    nesting = parsed(text)
    assert not nesting.tags & {"script", "link", "img", "iframe", "object", "image"}
    assert not [name for name, _ in nesting.attributes if name == "src" or name.startswith("on")]
    assert not re.search(r"https?:|url\((?!#)|@import|//\w", text)
    assert all(place[1:] in nesting.names for place in re.findall(r"url\((#[^)]*)\)", text))


def test_what_is_said_is_no_mark_up() -> None:
    text = rendered()
    assert "&lt;b&gt;no mark-up&lt;/b&gt;" in text
    assert "another &lt;path&gt;" in text
    assert 'aria-label="Figure 4.14: curves &#34;of&#34; the return"' in text
    assert "\N{MINUS SIGN}14 of 2026-01-02" in text


def test_it_shows_verdicts_reasons_and_what_could_not_run() -> None:
    text = rendered()
    assert "= matches</span>: 1" in text
    assert "differs</span>: 1" in text
    assert "squares look alike" in text
    assert "not shown" not in text
    assert text.count("no data set &lt;here&gt;") == 2  # in the summary and in its section
    assert "<b>Figure 4.14</b>" in text
    assert "<b>Table 4.1</b>" in text
    assert page.MARK in text


@pytest.mark.parametrize("quick", [True, False])
def test_a_quick_run_says_so(quick: bool) -> None:
    assert ("A quick run" in rendered(quick)) is quick


def test_a_drawing_follows_the_page_and_keeps_what_is_written() -> None:
    svg = drawn()
    assert svg.startswith("<svg")
    assert "currentColor" in svg
    assert figures.INK not in svg
    assert "μ = 0.001" in svg
    assert "<style" not in svg
    assert not re.search(r'<svg[^>]* (width|height)="', svg)
    assert "viewBox" in svg
    assert not re.search(r'="[^"]*\d\.\d{3}', svg)
    assert drawn() == svg
