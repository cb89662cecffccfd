"""How well the classes agree with what truly touches, which only the simulator knows; not in the thesis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from experiments.reproduce import classifier_figures as figures
from experiments.reproduce.chapter import Block, Comparison, Comparisons, Figure, Heading, Table, Text
from experiments.reproduce.classifier_runs import SETTINGS, Learnt, Shown, Source, learnt
from experiments.reproduce.classifier_thesis import RHO
from experiments.reproduce.context import Context
from experiments.reproduce.verdicts import near

THETAS, QUICK_THETAS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3), (0.0, 0.05, 0.2)


def truth(context: Context, sources: Sequence[Source], rhos: Sequence[float]) -> tuple[Block, ...]:
    """Return the part of the chapter."""
    thetas = QUICK_THETAS if context.quick else THETAS
    keys = [
        Shown(source.sha256, 0, sum(map(len, source.groups)), replace(SETTINGS, rho=rho, theta=theta))
        for theta in thetas
        for rho in rhos
        for source in sources
    ]
    done = iter(learnt(context, "agreement with the truth", sources, keys))
    runs = {(theta, rho): [next(done) for _ in sources] for theta in thetas for rho in rhos}
    ari = np.array([[_mean(runs[theta, rho], "ari") for rho in rhos] for theta in thetas])
    usual = SETTINGS.theta
    best = [max(rhos, key=lambda rho: runs[usual, rho][number].ari) for number in range(len(sources))]
    mean = "one recording" if len(sources) == 1 else f"mean of {len(sources)} recordings"
    return (
        Heading("Agreement with the true contact states"),
        Text(
            "The simulator knows what touches: at each point the feature (chamfer, bore, mouth, top) and the octant "
            "of the hole. A true state is the set of all points that touch, here "
            f"{_states(sources)} of them. The adjusted Rand index (ARI) is 1 when classes and true states are the same "
            "partition and 0 when they agree no better than chance; purity is the part of the vectors whose true state "
            "is the commonest of their class, and rises by itself with the number of classes."
        ),
        Figure(
            "",
            f"Adjusted Rand index by vigilance and threshold, {mean}. Brighter is better.",
            figures.agreement(rhos, thetas, ari),
        ),
        Table(
            "",
            f"Agreement with the truth at θ = {usual:g}, {mean}.",
            (RHO, "classes", "purity", "ARI", "ARI, octants only", "ARI, features only", "best θ", "ARI with it"),
            _rows(rhos, thetas, runs),
        ),
        Text(in_words(rhos, thetas, ari, usual)),
        Text(_sides([run for rho in rhos for run in runs[usual, rho]])),
        Comparisons(
            (
                Comparison(
                    f"{RHO} at which the classes agree best with what truly touches (θ = {usual:g})",
                    "0.93 or 0.94, judged the best division (4.6)",
                    best,
                    near(0.935, 0.0151),
                    "Agreement hardly changes in between, so that the best value is left to chance.",
                    note="One value for each recording; matches from 0.92 to 0.95.",
                ),
            ),
            "The best vigilance",
        ),
    )


def in_words(rhos: Sequence[float], thetas: Sequence[float], ari: NDArray[np.float64], usual: float) -> str:
    """Return what agreement by vigilance and threshold shows; ``ari`` of shape (len(thetas), len(rhos))."""
    row, column = divmod(int(ari.argmax()), len(rhos))
    at_usual = ari[thetas.index(usual)]
    good = [rho for rho, value in zip(rhos, at_usual, strict=True) if value >= 0.9 * at_usual.max()]
    by_theta, by_rho = float(np.ptp(ari, axis=0).max()), float(np.ptp(ari, axis=1).max())
    matters = "matters less than" if by_theta < by_rho else "matters as much as"
    return (
        f"What it shows: agreement is best at {RHO} = {rhos[column]:.2f} and θ = {thetas[row]:g} "
        f"(ARI {ari[row, column]:.2f}), and at θ = {usual:g} within a tenth of its best from {RHO} = "
        f"{min(good):.2f} to {max(good):.2f}; with less, different contacts share a class, with more, one contact is "
        f"split over many. The threshold {matters} the vigilance: it changes the index by at most {by_theta:.2f}, the "
        f"vigilance by up to {by_rho:.2f}."
    )


def _sides(runs: Sequence[Learnt]) -> str:
    side, feature = _mean(runs, "ari_side"), _mean(runs, "ari_feature")
    more = "more" if side > feature else "no more"
    return (
        f"Even the best is far from 1. The classes tell {more} about the side on which the peg touches than about what "
        f"it touches there: over all {RHO}, the index is {side:.2f} on average when the truth is the octants alone, "
        f"and {feature:.2f} when it is the features alone. A direction of force and torque hardly says whether it is "
        "from the chamfer, the bore or the mouth; the thesis meets this as overlap of classes (6.5, 7.4)."
    )


def _rows(
    rhos: Sequence[float], thetas: Sequence[float], runs: Mapping[tuple[float, float], Sequence[Learnt]]
) -> list[tuple[str, ...]]:
    rows = list[tuple[str, ...]]()
    for rho in rhos:
        of = runs[SETTINGS.theta, rho]
        by_theta = {theta: _mean(runs[theta, rho], "ari") for theta in thetas}
        best = max(by_theta, key=lambda theta: by_theta[theta])
        values = [_mean(of, name) for name in ("purity", "ari", "ari_side", "ari_feature")]
        cells = (f"{value:.2f}" for value in values)
        rows.append((f"{rho:.2f}", f"{_mean(of, 'classes'):.1f}", *cells, f"{best:g}", f"{by_theta[best]:.2f}"))
    return rows


def _mean(runs: Sequence[Learnt], name: str) -> float:
    return float(np.mean([getattr(run, name) for run in runs]))


def _states(sources: Sequence[Source]) -> int:
    return len({sample.truth for source in sources for group in source.groups for sample in group})
