"""``bench classifiers``: all installed classifiers beside each other, on vectors whose true contact state is known."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from experiments.bench.values import Value, spread
from experiments.lab.agreement import adjusted_rand_index, purity
from experiments.lab.contact_states import Sample
from experiments.lab.in_process import InProcessRun
from experiments.lab.recordings import cell, record
from services.cell.traffic import percentile
from services.classifier.fold import classifier_of
from services.rules import plugins
from services.wire.definition import Art2Settings, ClassifierSettings, Definition, Plugin


def measure(definition: Definition, seed: int, vectors: int, episodes: int, rounds: int) -> dict[str, Value]:
    """Measure time, classes, agreement with the true contact states, and what a learner makes of the classes.

    Each round has vectors and a run of its own, of the seeds ``seed``, ``seed + 1`` and so on. Each classifier has its
    default settings; ART2 those of the definition.
    """
    recordings = [_vectors(number, vectors) for number in range(seed, seed + rounds)]
    classifiers: list[Value] = []
    for name, settings in _all(definition).items():
        judged = [_judge(settings, samples) for samples in recordings]
        runs = [_learn(definition, settings, number, episodes) for number in range(seed, seed + rounds)]
        columns = {key: spread([run[key] for run in judged]) for key in judged[0]}
        columns |= {key: spread([run[key] for run in runs]) for key in runs[0]}
        classifiers.append({"classifier": name, **columns})
    return {
        "experiment": definition.name,
        "seed": seed,
        "rounds": rounds,
        "vectors": vectors,
        "episodes": episodes,
        "classifiers": classifiers,
    }


def _all(definition: Definition) -> dict[str, ClassifierSettings]:
    art2 = definition.classifier if isinstance(definition.classifier, Art2Settings) else Art2Settings()
    names = sorted(plugins.installed(plugins.CLASSIFIERS))
    return {"art2": art2, **{name: Plugin(name=name) for name in names}}


def _vectors(seed: int, count: int) -> list[Sample]:
    return [sample for insertion in record(cell(), seed, count) for sample in insertion.samples]


def _judge(settings: ClassifierSettings, samples: Sequence[Sample]) -> dict[str, float]:
    """Present recorded vectors once, in order; agreement is that of the second half, when the classes have formed."""
    network = classifier_of(settings)
    states, taken_us = [], []
    for sample in samples:
        began = time.perf_counter()
        state = network.learn(sample.force_n, sample.torque_nm).state
        taken_us.append(1e6 * (time.perf_counter() - began))
        states.append(state)
    half = len(samples) // 2
    truth = {name: number for number, name in enumerate(sorted({sample.truth for sample in samples}))}
    true = [truth[sample.truth] for sample in samples[half:]]
    return {
        "step_median_us": percentile(taken_us[half:], 50),
        "classes": float(network.states),
        "purity": purity(states[half:], true),
        "adjusted_rand_index": adjusted_rand_index(states[half:], true),
    }


def _learn(definition: Definition, settings: ClassifierSettings, seed: int, episodes: int) -> dict[str, float]:
    """Learn with a classifier; figures of the last quarter."""
    run = InProcessRun(replace(definition, classifier=settings), seed)
    last = list(run.episodes(episodes))[-max(1, episodes // 4) :]
    return {
        "return_last_quarter": float(np.mean([episode.episode_return for episode in last])),
        "success_last_quarter": float(np.mean([episode.outcome == "inserted" for episode in last])),
    }
