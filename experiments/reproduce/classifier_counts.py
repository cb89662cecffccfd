"""How many classes there are by vigilance (Fig. 4.22), and what the sensor's noise has to do with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from msgspec.structs import replace

from experiments.lab.recordings import Supervised
from experiments.reproduce import classifier_figures as figures
from experiments.reproduce import classifier_thesis as thesis
from experiments.reproduce.chapter import Block, Comparison, Comparisons, Figure, Heading, Table, in_all_seeds
from experiments.reproduce.classifier_real import Real
from experiments.reproduce.classifier_runs import (
    PART_VECTORS,
    SETTINGS,
    Groups,
    Learnt,
    Part,
    Shown,
    Source,
    learnt,
    record_part,
)
from experiments.reproduce.classifier_thesis import RHO
from experiments.reproduce.context import Context
from experiments.reproduce.verdicts import interval, near

WITHIN = 1 / 3
"""Numbers of classes match when they are this close to the thesis's, as a part of it."""


def counts(
    context: Context, runs: Mapping[float, Sequence[Learnt]], from_robot: Real | None, source: Source
) -> tuple[Block, ...]:
    """Return the part of the chapter; ``source`` is the first recording."""
    classes_of = {rho: [run.classes for run in of] for rho, of in runs.items()}
    robot = {} if from_robot is None else {rho: of[0].classes for rho, of in from_robot.runs.items()}
    return (
        Heading("How many classes there are"),
        Figure(
            "4.22",
            "Number of classes by vigilance: ours, median and 90 % band of the seeds; crosses are the numbers that the "
            "thesis tells, its drawing is lost. The axis is logarithmic.",
            figures.classes(classes_of, thesis.CLASSES, robot),
        ),
        Table("", "Number of classes by vigilance.", (RHO, "thesis", "Treenail, median", "90 %"), _rows(classes_of)),
        *(() if context.quick else _noise(context, list(runs), source)),
        Comparisons(_comparisons(classes_of), "Number of classes; matches within a third of the thesis's number"),
    )


def _rows(counts: Mapping[float, Sequence[int]]) -> list[tuple[str, str, str, str]]:
    rows = []
    for rho, values in counts.items():
        low, median, high = interval(values)
        rows.append((f"{rho:.2f}", str(thesis.CLASSES.get(rho, "not told")), f"{median:g}", f"{low:g} to {high:g}"))
    return rows


def _noise(context: Context, rhos: Sequence[float], source: Source) -> tuple[Block, ...]:
    """Return what the sensor's noise has to do with it, from the same insertions without it."""
    (quiet,) = context.pieces(
        "insertions, recorded without noise", [Part(0, PART_VECTORS, noisy=False)], record_part, list[Supervised]
    )
    sources = [Source.of(first(source.groups, PART_VECTORS)), Source.of([execution.samples for execution in quiet])]
    keys = [Shown(shown.sha256, 0, PART_VECTORS, replace(SETTINGS, rho=rho)) for shown in sources for rho in rhos]
    done = learnt(context, "noise, classified", sources, keys)
    noisy, silent = done[: len(rhos)], done[len(rhos) :]
    rows = [(f"{rho:.2f}", str(a.classes), str(b.classes)) for rho, a, b in zip(rhos, noisy, silent, strict=True)]
    caption = f"What noise does: classes of {PART_VECTORS} vectors, with sensor noise and without, same seed."
    return (Table("", caption, (RHO, "with noise", "without"), rows),)


def first(groups: Groups, vectors: int) -> Groups:
    """Return as many groups from the beginning as hold that many vectors."""
    chosen: Groups = []
    while sum(map(len, chosen)) < vectors:
        chosen.append(groups[len(chosen)])
    return chosen


def _comparisons(counts: Mapping[float, Sequence[int]]) -> list[Comparison]:
    whys = {
        0.93: "The thesis's number leaps to 18 here and is the same at 0.94; ours rises evenly, in every recording.",
        0.99: "At this vigilance the number hangs on the sensor's noise (the full report has a table); how noisy the "
        "thesis's vectors were is not known.",
    }
    usual = "Other insertions of another peg, and settings of the network that the thesis does not tell."
    rows = [
        Comparison(
            f"Classes at {RHO} = {rho:.2f}",
            f"{told} (4.5.2, 4.6)",
            [float(value) for value in counts[rho]],
            near(told, WITHIN * told),
            whys.get(rho, usual),
        )
        for rho, told in thesis.CLASSES.items()
    ]
    rhos = list(counts)
    seeds = range(len(counts[rhos[0]]))
    table = {seed: [counts[rho][seed] for rho in rhos] for seed in seeds}
    return [
        *rows,
        in_all_seeds(
            "The number of classes rises with the vigilance, and most steeply near 1",
            "yes (Fig. 4.22, 4.6)",
            [rises(table[seed]) for seed in seeds],
            f"With few vectors two neighbouring values of {RHO} may give a class more or less.",
            note="Next to each other one class fewer is let pass as chance; the last step has to be the largest.",
        ),
    ]


def rises(classes: Sequence[int]) -> bool:
    """Return whether there are more and more classes, but for one fewer by chance, and most in the last step."""
    steps = np.diff(classes)
    return bool((steps >= -1).all() and steps[-1] == steps.max())
