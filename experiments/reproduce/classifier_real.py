"""The same network on recordings of a real robot: the data set "Robot Execution Failures", if it is there."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from experiments.lab.contact_states import Sample
from experiments.lab.recordings import COLUMNS, FAILURES, SAMPLES, DataError, Execution, read_failures
from experiments.reproduce import classifier_thesis as thesis
from experiments.reproduce.chapter import Block, Comparison, Comparisons, Heading, Table, Text
from experiments.reproduce.classifier_runs import SETTINGS, Groups, Learnt, Shown, Source, learnt, looked_at, settled_at
from experiments.reproduce.classifier_thesis import RHO
from experiments.reproduce.context import Context
from experiments.reproduce.verdicts import at_most, interval, near

DATA = "TREENAIL_DATA"
"""Environment variable that stands in for --data."""
_RAW = replace(SETTINGS, torque_gain_per_m=1.0)
"""The numbers of the files as they are: nobody knows the units."""


PROBLEMS = {
    "lp1": "approach to grasp position",
    "lp2": "transfer of a part",
    "lp3": "position of the part after a failed transfer",
}
"""What the robot was doing, as the data set's description has it."""


@dataclass(frozen=True)
class Real:
    """What the network made of the data set, by vigilance and seed."""

    executions: Mapping[str, Sequence[Execution]]
    runs: Mapping[float, Sequence[Learnt]]
    presentations: int


def real(context: Context, rhos: Sequence[float], presentations: int) -> Real | None:
    """Show the data set's vectors to the network, None without one; DataError when it is not right."""
    folder = data_folder(context)
    if folder is None:
        return None
    executions = read_failures(folder)
    source = Source.of(grouped(executions))
    runs = [Shown(source.sha256, seed, presentations, replace(_RAW, rho=rho)) for rho in rhos for seed in context.seeds]
    done = learnt(context, "real recordings, classified", [source], runs)
    count = len(context.seeds)
    by_rho = {rho: done[index * count : (index + 1) * count] for index, rho in enumerate(rhos)}
    return Real(executions, by_rho, presentations)


def data_folder(context: Context) -> Path | None:
    """Return where the data sets are, by --data or the environment; DataError when the latter names no folder."""
    told = os.environ.get(DATA)
    if context.data is not None or not told:
        return context.data
    if not Path(told).is_dir():
        raise DataError(f"{DATA}: expected a folder, got {told}")
    return Path(told)


def grouped(executions: Mapping[str, Sequence[Execution]]) -> Groups:
    """Return the vectors, execution by execution, without those that are all zero: they have no direction."""
    return [
        [Sample(vector[:3], vector[3:], f"{problem} {execution.label}") for vector in execution.samples if any(vector)]
        for problem, of in executions.items()
        for execution in of
    ]


def blocks(real: Real | None) -> tuple[Block, ...]:
    """Return the part of the chapter."""
    heading = Heading("Recordings of a real robot")
    if real is None:
        missing = (
            "Not computed: no data set was given. With the files "
            f"{', '.join(f'{name}.data' for name in FAILURES)} of UCI's “Robot Execution Failures” in a folder, "
            f"--data FOLDER or {DATA}=FOLDER adds what the network makes of them."
        )
        return (heading, Text(missing))
    return (
        heading,
        Text(_what(real)),
        Table("", "The data set's vectors: classes by vigilance.", _HEAD, _rows(real)),
        Comparisons(_comparisons(real), "The thesis's recordings and those of another real robot"),
        Text(_labels(real)),
    )


_KEPT = "\N{NO-BREAK SPACE}"
_HEAD = (RHO, "classes", "five probes keep their classes from", "ARI with the labels", "purity")


def _what(real: Real) -> str:
    counts = ", ".join(f"{len(of)} of {name.upper()} ({PROBLEMS[name]})" for name, of in real.executions.items())
    vectors = [vector for of in real.executions.values() for execution in of for vector in execution.samples]
    zeros = sum(not any(vector) for vector in vectors)
    without = f" but {zeros} that are all zero" if zeros else ""
    rest = ", ".join(
        f"{name} {value:g}" for name, value in zip(COLUMNS, np.median(np.array(vectors), axis=0), strict=True)
    )
    return (
        "UCI's data set “Robot Execution Failures” (L. Seabra Lopes and L. M. Camarinha-Matos, 1999) has what a real "
        f"robot's wrist felt when a move went wrong, or not: {SAMPLES} samples within 315 ms of each execution, "
        f"{counts}. The six columns are {', '.join(COLUMNS[:3])} (forces) and {', '.join(COLUMNS[3:])} (torques), "
        "whole numbers. The description of the data set names no units, so the network is shown the bare numbers, "
        f"torques with gain 1. The load at rest is in them (medians: {rest}). All {len(vectors)} vectors{without} "
        f"are shown, execution by execution, and again in another order until there are {real.presentations} "
        "presentations. It is another robot at another task: its numbers of classes need not be the thesis's, but "
        "they may grow alike."
    )


def _rows(real: Real) -> list[tuple[str, ...]]:
    when = looked_at(real.presentations)
    rows = []
    for rho, runs in real.runs.items():
        classes = interval([run.classes for run in runs])
        settled = interval([settled_at(when, run.looks) for run in runs])
        ari, pure = np.mean([(run.ari, run.purity) for run in runs], axis=0)
        shown = (
            f"{figure.median:g} ({figure.low:g} to {figure.high:g})".replace(" ", _KEPT)
            for figure in (classes, settled)
        )
        rows.append((f"{rho:.2f}", *shown, f"{ari:.2f}", f"{pure:.2f}"))
    return rows


def growth(classes: Mapping[float, float]) -> float:
    """Return how many times more classes there are at the largest vigilance than at the smallest."""
    return classes[max(classes)] / classes[min(classes)]


def _comparisons(real: Real) -> list[Comparison]:
    when = looked_at(real.presentations)
    seeds = range(len(real.runs[0.95]))
    times = growth(thesis.CLASSES)
    grown = [growth({rho: float(runs[seed].classes) for rho, runs in real.runs.items()}) for seed in seeds]
    settled = [float(settled_at(when, run.looks)) for run in real.runs[0.95]]
    return [
        Comparison(
            f"Real recordings: how many times more classes at {RHO} = 0.99 than at 0.90",
            f"{times:.3g} times: from 10 to 104 (4.6)",
            grown,
            near(times, times / 3),
            "The forces of a collision in mid-air are spread otherwise than those of an insertion.",
            note="Matches within a third.",
        ),
        Comparison(
            f"Real recordings, {RHO} = 0.95: five probes keep their classes",
            "from 7000 (Table 4.3)",
            settled,
            at_most(7000),
            "Vectors between two classes may change theirs at any time.",
            note="In presentations. No better than the thesis's whatever it is: the same vectors come again and again.",
        ),
    ]


def _labels(real: Real) -> str:
    best = max(float(np.mean([run.ari for run in runs])) for runs in real.runs.values())
    return (
        f"With the labels of the executions the classes have little to do (adjusted Rand index at most {best:.2f}): "
        "a label says what had gone wrong over 315 ms, a class what is felt at one moment of it."
    )
