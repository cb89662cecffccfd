"""The figures of the chapter on the classifier (thesis Figs. 4.22, 4.23, A.3 to A.12, and one of our own)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from experiments.reproduce.classifier_thesis import RHO
from experiments.reproduce.figures import BLUE, GREEN, INK, SIZE_INCH, VERMILION, band, drawing, svg

SHOWN_CLASSES = 60
"""Most classes in a histogram; those born later are few and small."""


def classes(ours: Mapping[float, Sequence[int]], thesis: Mapping[float, int], real: Mapping[float, int]) -> str:
    """Fig. 4.22: number of classes by vigilance, ours of each seed, the thesis's, and of real recordings if any."""
    with drawing() as (figure, ((axes,),)):
        rhos = list(ours)
        band(axes, rhos, np.array([ours[rho] for rho in rhos], dtype=float).T, BLUE, "our recordings")
        if real:
            axes.plot(list(real), list(real.values()), color=GREEN, linestyle="--", label="a real robot, other task")
        axes.plot(list(thesis), list(thesis.values()), "x", color=VERMILION, markersize=7, label="thesis", zorder=3)
        axes.set(xlabel=f"vigilance {RHO}", ylabel="classes", yscale="log", xticks=rhos)
        axes.set_yticks([5, 10, 20, 50, 100, 200], ["5", "10", "20", "50", "100", "200"])
        axes.minorticks_off()
        axes.legend(loc="upper left")
        return svg(figure)


def classes_by_reading(rhos: Sequence[float], ours: Mapping[str, Sequence[int]], thesis: Mapping[float, int]) -> str:
    """Fig. 4.22 again: number of classes by vigilance, by reading of the reset vector."""
    with drawing() as (figure, ((axes,),)):
        for (reading, counts), dashes in zip(ours.items(), ("-", "--", ":"), strict=True):
            axes.plot(rhos, counts, linestyle=dashes, marker=".", label=reading)
        axes.plot(list(thesis), list(thesis.values()), "x", color=INK, markersize=7, label="thesis")
        axes.set(xlabel=f"vigilance {RHO}", ylabel="classes", yscale="log", xticks=list(rhos))
        axes.set_yticks([1, 2, 5, 10, 20, 50, 100], ["1", "2", "5", "10", "20", "50", "100"])
        axes.minorticks_off()
        axes.legend(loc="upper left")
        return svg(figure)


def histogram(sizes: Sequence[int]) -> str:
    """Fig. 4.23: how many vectors each class was given."""
    with drawing() as (figure, ((axes,),)):
        _bars(axes, sizes)
        axes.set(xlabel="class, by order of birth", ylabel="vectors")
        return svg(figure)


def histograms(sizes: Mapping[float, Sequence[int]]) -> str:
    """Figs. A.3 to A.12: the same for every vigilance."""
    rows = -(-len(sizes) // 2)
    with drawing(rows, 2, 1.55 * rows + 0.3) as (figure, grid):
        places = grid.flatten()
        for axes, (rho, counts) in zip(places, sizes.items(), strict=False):
            _bars(axes, counts)
            more = f", first {SHOWN_CLASSES}" if len(counts) > SHOWN_CLASSES else ""
            axes.set_title(f"{RHO} = {rho:.2f}: {len(counts)} classes{more}", fontsize=9)
        for axes in places[len(sizes) :]:
            axes.axis("off")
        figure.supylabel("vectors", fontsize=9.5, color=INK)
        return svg(figure)


def _bars(axes: Axes, sizes: Sequence[int]) -> None:
    shown = sizes[:SHOWN_CLASSES]
    axes.bar(range(1, len(shown) + 1), shown, color=BLUE, width=0.8)
    axes.set_xlim(0.3, len(shown) + 0.7)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=8))
    axes.grid(visible=False, axis="x")


def agreement(rhos: Sequence[float], thetas: Sequence[float], ari: NDArray[np.float64]) -> str:
    """Draw agreement with the truth as a grid; ``ari`` of shape (len(thetas), len(rhos))."""
    with drawing(height_inch=0.75 * SIZE_INCH[1] + 0.12 * len(thetas)) as (figure, ((axes,),)):
        # The page may be light or dark: every cell has its own ground, and ink that stands out on it.
        low, high = float(ari.min()), float(ari.max())
        axes.imshow(ari, cmap="cividis", aspect="auto", vmin=low, vmax=high)
        for (row, column), value in np.ndenumerate(ari):
            dark = value - low < 0.55 * (high - low)
            text = f"{value:.2f}".removeprefix("0")
            axes.text(column, row, text, ha="center", va="center", fontsize=9, color="#ffffff" if dark else "#101010")
        axes.set_xticks(range(len(rhos)), [f"{rho:.2f}" for rho in rhos])
        axes.set_yticks(range(len(thetas)), [f"{theta:g}" for theta in thetas])
        axes.set(xlabel=f"vigilance {RHO}", ylabel="threshold θ")
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
        return svg(figure)
