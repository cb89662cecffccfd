"""What a section of the reproduction report is made of.

To add a section:

1. Write a module with ``chapter(context: Context) -> Chapter`` and list it in ``experiments/reproduce/sections.py``.
2. Give long work to ``context.pieces``: each piece runs in another process, and once finished it is kept
   on disk, so that an interrupted report goes on where it stopped::

       @dataclass(frozen=True)
       class Run:            # the key: whatever the result depends on, and a version
           kind: str
           seed: int
           version: int = 1  # raise it when the code changes what comes out

       def falls(run: Run) -> list[int]: ...    # at the top of a module, so that a process finds it

       results = context.pieces("cliff falls", [Run("sarsa", seed) for seed in context.seeds], falls, list[int])

   Keys and results are what msgspec writes as JSON: dataclasses, numbers, text, lists; no NaN, no infinity.
3. Draw with ``figures.drawing()`` and ``figures.svg()``, which make lines legible on light and dark pages.
4. Say what the thesis has and what we have with ``Comparison``; every one that can differ says why.
5. Raise ``CannotRun`` when something is not there, such as a data set: the report says so in place of the results.
   With ``context.quick`` do less (shorter runs; the seeds are already fewer), and say so in the text.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from experiments.reproduce.context import Context
from experiments.reproduce.verdicts import Rule, Verdict, interval
from services.wire.errors import TreenailError


class CannotRun(TreenailError):
    """A section lacks something that it needs; the message says what, and the report shows it."""


@dataclass(frozen=True)
class Text:
    """A paragraph in plain words."""

    text: str


@dataclass(frozen=True)
class Heading:
    """Begins a part of the chapter; it also stands in the table of contents."""

    text: str


@dataclass(frozen=True)
class Figure:
    """A drawing from ``figures.svg``."""

    number: str
    """Its number in the thesis, such as ``4.14``; empty for a figure of our own."""
    caption: str
    svg: str


@dataclass(frozen=True)
class Table:
    """A table of text; ValueError when a row is not as long as the head."""

    number: str
    """Its number in the thesis, such as ``4.1``; empty for a table of our own."""
    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    def __post_init__(self) -> None:
        if any(len(row) != len(self.head) for row in self.rows):
            raise ValueError(f"table {self.number or self.caption!r}: expected {len(self.head)} cells in every row")


@dataclass(frozen=True)
class Comparison:
    """One number or statement of the thesis beside ours; ValueError when the verdict cannot be told or explained."""

    what: str
    thesis: str
    """What the thesis has, as it is to be read, with unit and page or table."""
    ours: Sequence[float] | str
    """One value a seed, or what we found in words."""
    verdict: Rule | Verdict
    """A rule of ``verdicts`` for values; for words the verdict itself."""
    why: str = ""
    """A sentence that is shown when ours differs: where that comes from. Needed wherever it can differ."""
    unit: str = ""
    note: str = ""
    """A sentence that is always shown."""

    def __post_init__(self) -> None:
        if isinstance(self.ours, str) and not isinstance(self.verdict, Verdict):
            raise ValueError(f"comparison {self.what!r}: expected a verdict for what is said in words, got a rule")
        if not self.ours:
            raise ValueError(f"comparison {self.what!r}: expected ours, got nothing")
        can_differ = not isinstance(self.verdict, Verdict) or self.verdict is Verdict.DIFFERS
        if can_differ and not self.why:
            raise ValueError(f"comparison {self.what!r}: expected a sentence why it differs, got none")

    @property
    def outcome(self) -> Verdict:
        """The verdict, by the rule where there is one."""
        if isinstance(self.verdict, Verdict):
            return self.verdict
        assert not isinstance(self.ours, str)
        return self.verdict(self.ours)

    @property
    def ours_shown(self) -> str:
        """Median and 90 % interval of the values with their unit, or the words."""
        if isinstance(self.ours, str):
            return self.ours
        median, bracket, rest = spread(self.ours).partition(" (")
        unit = f" {self.unit}" if self.unit else ""
        return f"{median}{unit}{bracket}{rest}"

    @property
    def remarks(self) -> tuple[str, ...]:
        """The sentences to be read with it."""
        why = self.why if self.outcome is Verdict.DIFFERS else ""
        return tuple(sentence for sentence in (self.note, why) if sentence)


def in_all_seeds(what: str, thesis: str, held: Sequence[bool], why: str, note: str = "") -> Comparison:
    """Return the comparison of a statement that has to hold for every seed; ``held`` says for which it does."""
    words = f"{sum(held)} of {len(held)} seeds"
    return Comparison(what, thesis, words, Verdict.MATCHES if all(held) else Verdict.DIFFERS, why, note=note)


@dataclass(frozen=True)
class Comparisons:
    """A table of comparisons; they also stand in the summary at the top of the page."""

    rows: Sequence[Comparison]
    caption: str = "The thesis and Treenail"


Block: TypeAlias = Text | Heading | Figure | Table | Comparisons


@dataclass(frozen=True)
class Chapter:
    """What a section gave, in reading order."""

    blocks: Sequence[Block] = field(default_factory=tuple)

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """All comparisons of the chapter, in order."""
        return tuple(row for block in self.blocks if isinstance(block, Comparisons) for row in block.rows)


@dataclass(frozen=True)
class Section:
    """One section of the report."""

    name: str
    """The word for ``--only``: small letters."""
    title: str
    run: Callable[[Context], Chapter]


def spread(values: Sequence[float]) -> str:
    """Return median and 90 % interval of the seeds' values as the report shows them."""
    low, median, high = interval(values)
    return shown(median) if low == high else f"{shown(median)} ({shown(low)} to {shown(high)})"


def shown(value: float) -> str:
    """Return a number as the report shows it: three significant digits, whole numbers in full, infinity as never."""
    if value == math.inf:
        return "never"
    if value == round(value) or abs(value) >= 1000:
        return f"{value:.0f}"
    return f"{value:.3g}"
