"""Curves over episodes with bands over seeds, several in a panel, told apart by colour and dash."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator
from numpy.typing import NDArray

from experiments.lab.plots import BAND_PERCENT, moving_average

__all__ = ["BLACK", "Style", "band", "legend", "moving_average", "png", "rate", "style", "tidy"]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Okabe and Ito's, told apart by everyone."""
DASHES = ("-", "--", "-.", ":")
TICKS_N = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
DOTS_PER_INCH = 100


class Style(NamedTuple):
    """How a curve looks."""

    colour: str
    dash: str


BLACK = Style("#000000", "-")
"""For what the others are held against."""


def style(number: int) -> Style:
    """Return the look of the ``number``-th curve, from 0; they repeat after 24."""
    return Style(COLOURS[number % len(COLOURS)], DASHES[number // len(COLOURS) % len(DASHES)])


def band(axes: Axes, values: NDArray[np.float64], look: Style, label: str) -> None:
    """Draw the median over the seeds of the mean of the last ten episodes, with the 5th to the 95th percentile.

    ``values`` have the shape (seeds, episodes).
    """
    means, episode = moving_average(values), np.arange(values.shape[1])
    low, middle, high = np.percentile(means, (BAND_PERCENT[0], 50.0, BAND_PERCENT[1]), axis=0)
    if len(values) > 1:
        axes.fill_between(episode, low, high, color=look.colour, alpha=0.18, linewidth=0)
    marker = "o" if values.shape[1] == 1 else None
    axes.plot(episode, middle, color=look.colour, linestyle=look.dash, linewidth=1.8, marker=marker, label=label)


def rate(axes: Axes, failed: NDArray[np.float64], look: Style, label: str) -> None:
    """Draw the part of all seeds' episodes that failed, over ten episodes; ``failed`` is 0 or 1, (seeds, episodes)."""
    share = 100.0 * moving_average(failed.mean(axis=0, keepdims=True))[0]
    marker = "o" if failed.shape[1] == 1 else None
    axes.plot(
        np.arange(failed.shape[1]),
        share,
        color=look.colour,
        linestyle=look.dash,
        linewidth=1.8,
        marker=marker,
        label=label,
    )


def tidy(axes: Axes) -> None:
    """Give a panel the looks of the others."""
    axes.tick_params(labelsize=9)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=5, integer=True, steps=[1, 2, 5, 10]))
    axes.grid(axis="y", color="#D9D9D9", linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def logarithmic(axes: Axes) -> None:
    """Put the forces of a panel, in newtons, on a logarithmic scale with plain numbers."""
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(FixedLocator(TICKS_N))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def legend(figure: Figure, panels: Sequence[Axes], columns: int) -> None:
    """Put one legend below all panels, each label once."""
    entries = {
        label: handle for axes in panels for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(
        list(entries.values()), list(entries), loc="outside lower center", ncols=columns, frameon=False, fontsize=10
    )


def png(figure: Figure) -> bytes:
    """Return a figure as a PNG image."""
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=DOTS_PER_INCH)
    return content.getvalue()
