"""Equation D.13, the reset vector, read in three ways: what each makes of Fig. 4.22."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from experiments.lab.contact_states import Sample
from experiments.reproduce import classifier_figures as figures
from experiments.reproduce import classifier_thesis as thesis
from experiments.reproduce.chapter import Block, Comparison, Comparisons, Figure, Heading, Table, Text
from experiments.reproduce.classifier_runs import SETTINGS, Source
from experiments.reproduce.classifier_thesis import RHO
from experiments.reproduce.context import Context
from experiments.reproduce.verdicts import Verdict
from services.classifier import art2_kernel as kernel
from services.classifier.encoding import encode, input_count

VECTORS = 2500
READINGS: Mapping[str, tuple[int, int]] = {
    "q' of F0": (0, kernel.Q),
    "q of F1": (1, kernel.Q),
    "u of F1": (1, kernel.U),
}
"""Layer and sublayer that stand for q in the equation. The second is what is printed."""
USED = "q' of F0"


@dataclass(frozen=True)
class Reading:
    """What a run of the network depends on."""

    source_sha256: str
    vectors: int
    rho: float
    reading: str
    version: int = 1


def readings(context: Context, source: Source, rhos: Sequence[float]) -> tuple[Block, ...]:
    """Return the part of the chapter; ``source`` is the first recording."""
    samples = [sample for group in source.groups for sample in group]
    samples = samples[:VECTORS]
    keys = [Reading(source.sha256, len(samples), rho, reading) for reading in READINGS for rho in rhos]
    classes = iter(context.pieces("vectors, classified by three readings", keys, partial(count, samples), int))
    by_reading = {reading: [next(classes) for _ in rhos] for reading in READINGS}
    rows = [(f"{rho:.2f}", *(str(by_reading[reading][n]) for reading in READINGS)) for n, rho in enumerate(rhos)]
    return (
        Heading("The reset vector, read in three ways"),
        Text(
            "Equation D.13 says how well a class fits. As printed (3041) it compares q of F1 with p of F1. But q is p, "
            "normalised (D.10): the two always point the same way, their match is 1 whatever was felt, and no "
            "vigilance ever resets anything. The text speaks of the bottom-up priming, and what comes to F1 from below "
            "is q' of F0: so Treenail reads it. Textbooks have u of F1 there, which settles close to the class it is "
            f"compared with. The same {len(samples)} vectors, by each:"
        ),
        Table("", "Number of classes by vigilance, by reading of D.13.", (RHO, *READINGS), rows),
        Figure(
            "4.22",
            "Number of classes by vigilance, by reading of D.13; crosses are the thesis's numbers, of more vectors.",
            figures.classes_by_reading(rhos, by_reading, thesis.CLASSES),
        ),
        Comparisons([_growth(by_reading)], "Which reading grows classes as the thesis's"),
    )


def _growth(by_reading: Mapping[str, Sequence[int]]) -> Comparison:
    words = [f"{reading}: {classes[0]} to {classes[-1]}" for reading, classes in by_reading.items()]
    grows = {reading for reading, classes in by_reading.items() if classes[-1] > 2 * classes[0]}
    return Comparison(
        f"Classes from {RHO} = 0.90 to 0.99, by reading of D.13",
        "from 10 to 104 (1653)",
        "; ".join(words),
        Verdict.MATCHES if grows == {USED} else Verdict.DIFFERS,
        "Another reading than the one that is used grows classes too, or that one does not.",
        note="Matches when the reading that is used grows them to more than twice as many, and no other does.",
    )


def count(samples: Sequence[Sample], reading: Reading) -> int:
    """Return how many classes there are when all was shown once, by a reading of D.13."""
    settings = replace(SETTINGS, rho=reading.rho)
    inputs = input_count(settings.encoding)
    weights, layers, units = np.zeros((settings.capacity, inputs)), np.zeros((2, kernel.SUBLAYERS, inputs)), 0
    for sample in samples:
        stimulus = encode(sample.force_n, sample.torque_nm, settings.torque_gain_per_m, settings.encoding)
        units += _learn(stimulus, weights, units, layers, reading)
    return units


def _learn(
    stimulus: NDArray[np.float64],
    weights: NDArray[np.float64],
    units: int,
    layers: NDArray[np.float64],
    reading: Reading,
) -> bool:
    """Present one vector and learn it; return whether a class was committed. As ``kernel.present`` but for D.13."""
    s = SETTINGS
    rest = (s.a, s.b, s.e, s.theta)
    f0, f1 = layers[0], layers[1]
    layers[:] = 0.0
    kernel.settle(f0, stimulus, stimulus, 0.0, *rest)
    kernel.settle(f1, f0[kernel.Q], stimulus, 0.0, *rest)
    primed = f1[kernel.U].copy()
    votes = (weights[:units] * f1[kernel.P]).sum(axis=1)
    layer, sublayer = READINGS[reading.reading]
    for unit in np.argsort(-votes, kind="stable"):
        if votes[unit] <= 0.0:
            break
        f1[kernel.U] = primed
        kernel.settle(f1, f0[kernel.Q], weights[unit], s.d, *rest)
        if kernel.match_of(layers[layer, sublayer], f1[kernel.P], s.c, s.e) + s.e >= reading.rho:
            kernel.learn(weights, unit, f1[kernel.U], s.d, s.learning_rate)
            return False
    f1[kernel.U] = primed
    kernel.settle(f1, f0[kernel.Q], stimulus, 0.0, *rest)
    kernel.learn(weights, units, f1[kernel.U], s.d, 1.0)
    return True
