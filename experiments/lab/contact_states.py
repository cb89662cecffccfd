"""How well ART2's classes agree with the simulator's true contact states, for a grid of its settings.

``python -m experiments.lab.contact_states [NAME]``. Runs of the experiment give force/torque vectors in contact and,
beside each, what really touches (``World.contact_state``: feature and octant of every touching point), which no learner
sees.
Every setting then learns each run's vectors afresh, in the order felt.
"""

from __future__ import annotations

import argparse
import itertools
import json
import statistics
import sys
import time
from collections.abc import Sequence
from typing import Literal, NamedTuple

from msgspec.structs import replace
from rich import box
from rich.table import Table

from experiments.lab.agreement import adjusted_rand_index, purity
from experiments.lab.in_process import InProcessRun
from services.cell.terminal import console
from services.classifier.art2 import Art2
from services.rules import command_line
from services.rules.command_line import Parser, whole
from services.rules.swaps import kind_of
from services.sim.contact_state import FREE
from services.wire import definition_file
from services.wire.definition import Art2Settings, Definition
from services.wire.errors import TreenailError
from services.wire.messages import Force, Move, Observation, Torque

PROGRAM = "python -m experiments.lab.contact_states"
RHO = (0.90, 0.91, 0.92, 0.93, 0.94, 0.95, 0.96, 0.97, 0.98)
THETA = (0.0, 0.02, 0.05, 0.1)
ENCODING: tuple[Literal["odd", "split"], ...] = ("odd", "split")
LEARNING_RATE = (0.1, 1.0)
TORQUE_GAIN_PER_M = (0.0, 3.0, 10.0, 30.0)
PROBES = 50
"""Vectors, evenly spaced over a run, whose class is looked up again and again."""
LOOKS = 5
"""Looks at the probes over the second half of a run, after a first one in its middle."""
LINE_EVERY_S = 15.0


class Sample(NamedTuple):
    """What was felt at a decision, and the true contact state."""

    force_n: Force
    torque_nm: Torque
    truth: str


class Score(NamedTuple):
    """How one setting did: means over the runs."""

    rho: float
    theta: float
    encoding: str
    learning_rate: float
    torque_gain_per_m: float
    classes: float
    """Number of classes at the end."""
    ari: float
    """Adjusted Rand index of the classes, as answered during learning, against the truth."""
    ari_spread: float
    """Standard deviation of it over the runs, 0 of one run: differences below it mean nothing."""
    purity: float
    """Fraction of vectors whose true state is the commonest of their class."""
    changes: float
    """Part of all looks in a run's second half, in percent, at which a probe's class was another than before."""

    @property
    def settings(self) -> tuple[object, ...]:
        """What was varied."""
        return self[:5]


class _RecordingRun(InProcessRun):
    """A run that writes down what was felt and what was true."""

    def __init__(self, definition: Definition, seed: int) -> None:
        super().__init__(definition, seed)
        self.samples: list[Sample] = []

    def _decide(self, observation: Observation) -> Move:
        truth = self.cell.world.contact_state()
        self.samples.append(Sample(observation.force_n, observation.torque_nm, truth))
        return super()._decide(observation)


def record(definition: Definition, seed: int, episodes: int) -> list[Sample]:
    """Return every decision of a run's first episodes, in order, from exploring to what is learnt by then."""
    run = _RecordingRun(definition, seed)
    for _ in run.episodes(episodes):
        pass
    return run.samples


def grid(base: Art2Settings) -> list[Art2Settings]:
    """Return all combinations of the settings varied, the rest as in ``base``."""
    return [
        replace(base, rho=rho, theta=theta, encoding=encoding, learning_rate=rate, torque_gain_per_m=gain)
        for rho, theta, encoding, rate, gain in itertools.product(
            RHO, THETA, ENCODING, LEARNING_RATE, TORQUE_GAIN_PER_M
        )
    ]


def score(settings: Art2Settings, runs: Sequence[Sequence[Sample]]) -> Score:
    """Let a fresh network learn each run; return the means. Raises ValueError for a run without samples."""
    rows = [_score_of_run(settings, samples) for samples in runs]
    classes, ari, pure, changes = (statistics.fmean(column) for column in zip(*rows, strict=True))
    spread = statistics.stdev(row[1] for row in rows) if len(rows) > 1 else 0.0
    varied = (settings.rho, settings.theta, settings.encoding, settings.learning_rate, settings.torque_gain_per_m)
    return Score(*varied, classes, ari, spread, pure, changes)


def _score_of_run(settings: Art2Settings, samples: Sequence[Sample]) -> tuple[float, float, float, float]:
    art2 = Art2(settings)
    probes = [samples[number * len(samples) // PROBES] for number in range(PROBES)]
    looks = {len(samples) - 1 - look * (len(samples) // 2) // LOOKS for look in range(LOOKS + 1)}
    classes, seen, changes = [], list[int](), 0
    for number, sample in enumerate(samples):
        classes.append(art2.learn(sample.force_n, sample.torque_nm).state)
        if number in looks:
            now = [art2.classify(probe.force_n, probe.torque_nm).state for probe in probes]
            changes += sum(a != b for a, b in zip(seen, now, strict=False))
            seen = now
    names = sorted({sample.truth for sample in samples})
    truth = [names.index(sample.truth) for sample in samples]
    moved = 100.0 * changes / (PROBES * max(1, len(looks) - 1))
    return float(art2.states), adjusted_rand_index(classes, truth), purity(classes, truth), moved


def one_at_a_time(scores: Sequence[Score], base: Score) -> list[Score]:
    """Return the scores that differ from ``base`` in one setting at most."""
    return [score for score in scores if sum(a != b for a, b in zip(score.settings, base.settings, strict=True)) <= 1]


def main(words: Sequence[str] | None = None) -> int:
    """Do what the command line (or ``words`` in its place) says and return the exit status."""
    return command_line.run(PROGRAM, lambda: _act(_parser().parse_args(words)))


def _act(arguments: argparse.Namespace) -> int:
    definition = definition_file.load(arguments.experiment, arguments.set)
    runs = [record(definition, seed, arguments.episodes) for seed in range(arguments.seeds)]
    settings = definition.classifier
    if not isinstance(settings, Art2Settings):
        raise TreenailError(f"classifier: expected art2, whose settings are tried out here, got {kind_of(settings)!r}")
    base = score(settings, runs)
    scores, said_s = [], time.monotonic()
    everything = grid(settings)
    for number, settings in enumerate(everything, start=1):
        scores.append(score(settings, runs))
        if time.monotonic() - said_s >= LINE_EVERY_S:
            said_s = time.monotonic()
            print(f"{number} of {len(everything)} settings", file=sys.stderr, flush=True)
    counts = [len(run) for run in runs]
    truths = len({sample.truth for run in runs for sample in run})
    free = sum(sample.truth == FREE for run in runs for sample in run)
    if arguments.json:
        told = {"samples": counts, "true_states": truths, "unlabelled": free, "base": base._asdict()}
        print(json.dumps({**told, "scores": [each._asdict() for each in scores]}, indent=2))
        return 0
    shown = console()
    shown.print(f"{definition.name}: samples by run {counts}, {truths} true contact states")
    shown.print(table("The definition's settings, and one of them changed", [base, *one_at_a_time(scores, base)]))
    best = sorted(scores, key=lambda each: -each.ari)
    shown.print(table("Best adjusted Rand index", best[: arguments.rows]))
    return 0


def table(title: str, scores: Sequence[Score]) -> Table:
    """Return scores as a table."""
    rows = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    rows.pad_edge, rows.collapse_padding = False, True  # so that it fits 80 columns
    for column in ("rho", "theta", "encoding", "rate", "gain", "classes", "ARI", "+-", "purity", "changes"):
        rows.add_column(column, justify="right")
    for score in scores:
        settings = (f"{score.rho:.2f}", f"{score.theta:.2f}", score.encoding, f"{score.learning_rate:g}")
        agreement = (f"{score.ari:.3f}", f"{score.ari_spread:.3f}", f"{score.purity:.3f}")
        rows.add_row(
            *settings, f"{score.torque_gain_per_m:g}", f"{score.classes:.1f}", *agreement, f"{score.changes:.1f} %"
        )
    return rows


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog=PROGRAM, description=__doc__)
    parser.add_argument("experiment", metavar="NAME_OR_FILE", nargs="?", default="chamfered-q-softmax")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="change a setting")
    parser.add_argument("--episodes", type=whole(), default=60, metavar="N", help="episodes of each run")
    parser.add_argument("--seeds", type=whole(), default=2, metavar="K", help="runs, seeds 0 to K-1")
    parser.add_argument("--rows", type=whole(), default=20, metavar="N", help="best settings shown")
    parser.add_argument("--json", action="store_true", help="print all settings as JSON")
    return parser


if __name__ == "__main__":
    sys.exit(main())
