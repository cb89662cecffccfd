"""Chapter 4 on the classifier: how many classes ART2 finds, whether they last, whether they are true (4.5.2, A.2).

All vectors go through the classifier service's own network.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from experiments.lab.recordings import THESIS_VECTORS, Supervised, cell
from experiments.reproduce import classifier_thesis as thesis
from experiments.reproduce.chapter import Block, Chapter, Heading, Table, Text
from experiments.reproduce.classifier_counts import counts
from experiments.reproduce.classifier_real import blocks, real
from experiments.reproduce.classifier_runs import (
    PART_VECTORS,
    QUICK_PART_VECTORS,
    QUICK_PARTS,
    SETTINGS,
    Learnt,
    Shown,
    Source,
    learnt,
    recordings,
)
from experiments.reproduce.classifier_stability import sizes, stability
from experiments.reproduce.classifier_truth import truth
from experiments.reproduce.context import Context
from experiments.reproduce.reset_vector import readings


def chapter(context: Context) -> Chapter:
    """Return the chapter; DataError when a data set is given that is not right."""
    rhos = thesis.QUICK_RHOS if context.quick else thesis.RHOS
    # First, so that a damaged file is told before minutes of work.
    from_robot = real(context, rhos, QUICK_PARTS * QUICK_PART_VECTORS if context.quick else THESIS_VECTORS)
    recorded = recordings(context)
    sources = [Source.of([execution.samples for execution in recording]) for recording in recorded]
    runs = _runs(context, sources, rhos)
    presentations = sum(map(len, sources[0].groups))
    return Chapter(
        (
            *_recorded(recorded, context.quick),
            *counts(context, runs, from_robot, sources[0]),
            *readings(context, sources[0], rhos),
            *stability(runs, presentations),
            *sizes(runs),
            *blocks(from_robot),
            *truth(context, sources, rhos),
        )
    )


def _runs(context: Context, sources: Sequence[Source], rhos: Sequence[float]) -> dict[float, list[Learnt]]:
    """Return a run for each vigilance and seed: all recordings as they are, then all of them in other orders."""
    keys = []
    for rho in rhos:
        for seed in range(len(context.seeds)):
            order, number = divmod(seed, len(sources))
            vectors = sum(map(len, sources[number].groups))
            keys.append(Shown(sources[number].sha256, order, vectors, replace(SETTINGS, rho=rho)))
    done = iter(learnt(context, "vectors, classified", sources, keys))
    return {rho: [next(done) for _ in context.seeds] for rho in rhos}


def _recorded(recorded: Sequence[Sequence[Supervised]], quick: bool) -> tuple[Block, ...]:
    noise = cell().noise
    part = QUICK_PART_VECTORS if quick else PART_VECTORS
    less = f" This quick run has one recording, of {QUICK_PARTS * QUICK_PART_VECTORS} vectors." if quick else ""
    rows = []
    for number, recording in enumerate(recorded):
        samples = [sample for execution in recording for sample in execution.samples]
        outcomes = Counter(execution.outcome for execution in recording)
        states = len({sample.truth for sample in samples})
        forces = np.percentile([float(np.linalg.norm(sample.force_n)) for sample in samples], (50, 95))
        cells = (f"{outcomes['inserted']} of {len(recording)}", str(states), f"{forces[0]:.1f} N, {forces[1]:.1f} N")
        rows.append((str(number), str(len(samples)), *cells))
    return (
        Heading("The vectors"),
        Text(
            f"The thesis recorded {THESIS_VECTORS} force/torque vectors from supervised insertions. Ours come from the "
            "simulated round peg in its chamfered hole (clearance 0.5 mm), from starts up to 2.4 mm and 2° off, with "
            "the noise of sensor and arm that the experiments have after 5.1 (standard deviations of the sensor "
            f"{noise.force_n:g} N and {noise.torque_nm:g} N m, of the arm {noise.along_mm:g} mm along a motion). The "
            "supervisor knows where the peg is: he steers for a point within 0.8 mm and 1° of the axis, another one "
            "each time, presses on, and makes 15 % of his moves at random. A vector is kept whenever the force is "
            f"0.3 N or more. Each recording is made of parts of {part} vectors; the last insertion of a part "
            "is cut short. The network is Treenail's, with the settings of its experiments." + less
        ),
        Table(
            "",
            "The recordings. A true contact state is the set of features and octants of the hole that touch.",
            ("recording", "vectors", "inserted", "true contact states", "force: median, 95 %"),
            rows,
        ),
    )
