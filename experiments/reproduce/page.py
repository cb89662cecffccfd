"""The report as one HTML file that needs nothing beside it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from experiments.reproduce.chapter import Chapter, Comparison, Section
from experiments.reproduce.verdicts import Verdict

MARK = '<meta name="generator" content="treenail reproduce">'
"""Stands in every page that we wrote, so that a page of somebody else is not overwritten."""
_TEMPLATE = Path(__file__).with_name("page.html")


@dataclass(frozen=True)
class Done:
    """A section and what came of it."""

    section: Section
    chapter: Chapter | None
    """None when it could not run."""
    reason: str = ""
    """Why it could not."""
    seconds: float = 0.0
    from_before: int = 0
    """Pieces of it that an earlier report had computed."""


def render(title: str, facts: Mapping[str, str], done: Sequence[Done], quick: bool) -> str:
    """Return the page; ``facts`` says by label what was run."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, finalize=_with_minus
    )
    environment.filters["drawn"] = _Drawn()
    environment.filters["anchor"] = anchor
    environment.filters["short"] = lambda title: title.partition(" (")[0]
    template = environment.from_string(_TEMPLATE.read_text(encoding="utf-8"))
    return template.render(
        title=title,
        mark=Markup(MARK),
        facts=facts,
        done=done,
        quick=quick,
        counts=counts([row for section in done if section.chapter for row in section.chapter.comparisons]),
    )


def counts(rows: Sequence[Comparison]) -> dict[str, int]:
    """Return how many comparisons came to each verdict, of all verdicts."""
    outcomes = [row.outcome for row in rows]
    return {str(verdict): outcomes.count(verdict) for verdict in Verdict}


def anchor(text: str) -> str:
    """Return a heading as the name of a place in the page."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")


def _with_minus(value: object) -> object:
    """Return text with true minus signs before its negative numbers; anything else, and mark-up, as it is."""
    if type(value) is not str:
        return value
    return re.sub(r"(?<![\w.,])-(?=\d)", "\N{MINUS SIGN}", value)


class _Drawn:
    """Puts drawings into the page, each with names of its own: names are shared by the whole page."""

    def __init__(self) -> None:
        self._numbers = count(1)

    def __call__(self, svg: str, caption: str) -> Markup:
        prefix = f"d{next(self._numbers)}-"
        own = re.sub(r'\bid="', f'id="{prefix}', svg)
        own = re.sub(r'href="#', f'href="#{prefix}', own).replace("url(#", f"url(#{prefix}")
        return Markup(own.replace("<svg", Markup('<svg role="img" aria-label="{}"').format(caption), 1))
