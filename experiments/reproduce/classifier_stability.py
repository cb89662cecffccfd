"""Stability of the classes: Tables 4.3 and A.2 to A.11, and how large the classes are (Figs. 4.23, A.3 to A.12)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from experiments.reproduce import classifier_figures as figures
from experiments.reproduce import classifier_thesis as thesis
from experiments.reproduce.chapter import Block, Comparison, Comparisons, Figure, Heading, Table, Text
from experiments.reproduce.classifier_runs import UNCLASSIFIED, Learnt, looked_at, settled_at
from experiments.reproduce.classifier_thesis import RHO
from experiments.reproduce.verdicts import among, at_most, interval

WORKING = 0.95
"""Vigilance of Table 4.3 and Fig. 4.23."""
STABLE = 7000
"""Presentations after which the thesis calls Table 4.3 stable."""


def stability(runs: Mapping[float, Sequence[Learnt]], presentations: int) -> tuple[Block, ...]:
    """Return the part about five vectors that are looked up again and again."""
    when = looked_at(presentations)
    theirs = {rho: [thesis.classes_of_probes(rho, at) for at in when] for rho in runs}
    return (
        Heading("Whether a vector keeps its class"),
        Text(
            "Five vectors A to E, drawn at random, are looked up after every 1000 presentations, without being learnt. "
            "Each cell of the tables: the thesis's class, then ours with seed 0, both counted from 1 in the order in "
            "which the classes arose, so that only changes can be compared. A dash: it fits no class yet; the thesis "
            "calls that class 1. Rows in which nothing is new are left out."
        ),
        *(_table(rho, of[0], when) for rho, of in runs.items()),
        Table(
            "",
            "Presentation from which on no probe changes its class.",
            ("table", RHO, "thesis", "Treenail, median", "90 %", f"seeds that change after {STABLE}"),
            [_row(rho, settled_at(when, theirs[rho]), _settled(when, of)) for rho, of in runs.items()],
        ),
        Text(
            "Five probes are few: with others, or in another order, the same network settles anywhere between the "
            "first look and the last, so that no single table can be told from the thesis's. Taken together they can. "
            f"The thesis says of Table 4.3 that its classes are stable after {STABLE} presentations (4.5.2), but "
            f"{_later()} of its other tables change later, the last at 16000."
            + (f" Its tables count as far as presentation {when[-1]} here." if when[-1] < thesis.LAST else "")
        ),
        Comparisons(_comparisons(runs, theirs, when), "Stability. Less is better: an agent has less to learn anew"),
    )


def sizes(runs: Mapping[float, Sequence[Learnt]]) -> tuple[Block, ...]:
    """Return the part about how many vectors each class was given."""
    first = {rho: of[0].sizes for rho, of in runs.items()}
    share = [sum(sorted(run.sizes)[-5:]) / sum(run.sizes) for run in runs[WORKING]]
    return (
        Heading("How large the classes are"),
        Figure(
            "4.23",
            f"How many vectors were given to each class at {RHO} = {WORKING}, seed 0. "
            f"The five largest hold {100 * sum(share) / len(share):.0f} % of them (mean of the seeds). The thesis's "
            "drawing is lost; it says that classes 6, 10 and 13 were among the largest of its 20.",
            figures.histogram(first[WORKING]),
        ),
        Figure(
            "A.3 to A.12",
            "The same for every vigilance computed. Classes in order of birth along the axis.",
            figures.histograms(first),
        ),
    )


def _table(rho: float, run: Learnt, when: Sequence[int]) -> Table:
    rows = []
    before: object = None
    for presentation, look in zip(when, run.looks, strict=True):
        theirs = thesis.classes_of_probes(rho, presentation)
        if (theirs, look) != before:
            cells = (f"{a} | {_name(b)}" for a, b in zip(theirs, look, strict=True))
            rows.append((str(presentation), *cells))
        before = (theirs, look)
    caption = f"{RHO} = {rho:.2f}: class of five vectors after so many presentations, thesis | Treenail."
    return Table(thesis.TABLES[rho], caption, ("from", "A", "B", "C", "D", "E"), rows)


def _name(state: int) -> str:
    return "-" if state == UNCLASSIFIED else str(state + 1)


def _settled(when: Sequence[int], runs: Sequence[Learnt]) -> list[float]:
    return [float(settled_at(when, run.looks)) for run in runs]


def _row(rho: float, theirs: int, values: Sequence[float]) -> tuple[str, ...]:
    low, median, high = interval(values)
    late = f"{sum(value > STABLE for value in values)} of {len(values)}"
    return (thesis.TABLES[rho], f"{rho:.2f}", str(theirs), f"{median:g}", f"{low:g} to {high:g}", late)


def _comparisons(
    runs: Mapping[float, Sequence[Learnt]], theirs: Mapping[float, Sequence[thesis.Row]], when: Sequence[int]
) -> list[Comparison]:
    moved = sum(changed(when, looks) for looks in theirs.values()) / len(runs)
    tables = sum(settled_at(when, looks) > STABLE for looks in theirs.values())
    ours = [_settled(when, of) for of in runs.values()]
    late = [float(sum(value > STABLE for value in of_seed)) for of_seed in zip(*ours, strict=True)]
    between = "Where a vector lies between two classes, either may win as both are learnt on."
    return [
        Comparison(
            f"{RHO} = {WORKING}: presentations after which five probes keep their classes",
            f"at most {STABLE} (4.5.2, Table 4.3)",
            _settled(when, runs[WORKING]),
            at_most(STABLE),
            between,
            note="Matches when the median is no later; the table above says how many seeds are.",
        ),
        Comparison(
            f"Tables, of {len(runs)}, in which a probe changes its class after presentation {STABLE}",
            f"{tables} (Tables A.2 to A.11)",
            late,
            among(tables, better="lower"),
            between,
        ),
        Comparison(
            f"Probes, of five, that change their class after presentation {STABLE}, mean over all {RHO}",
            f"{moved:.2g} (Tables A.2 to A.11)",
            _late(runs, when),
            among(moved, better="lower"),
            between,
        ),
    ]


def _late(runs: Mapping[float, Sequence[Learnt]], when: Sequence[int]) -> list[float]:
    """Return for each seed how many of the five probes change after presentation STABLE, mean over the vigilances."""
    seeds = range(len(next(iter(runs.values()))))
    return [sum(changed(when, of[seed].looks) for of in runs.values()) / len(runs) for seed in seeds]


def _later() -> int:
    """Return how many of the thesis's tables change after presentation STABLE."""
    return sum(max(table) > STABLE for table in thesis.PROBES.values())


def changed(when: Sequence[int], looks: Sequence[Sequence[int]], after: int = STABLE) -> int:
    """Return how many probes have more than one class in the looks from presentation ``after`` on."""
    late = [look for at, look in zip(when, looks, strict=True) if at >= after]
    return sum(len(set(column)) > 1 for column in zip(*late, strict=True))
