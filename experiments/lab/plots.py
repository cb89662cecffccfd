"""The thesis's four figures: return, mean force, mean torque and failures over the episodes (Figs. 6.6-6.10).

One seed is drawn as it is: every episode thin, the mean of the last ten on top. Several seeds are drawn as the median
of those means with a band from the 5th to the 95th percentile. Colours are Okabe and Ito's, told apart by everyone.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from services.rules.results import BLOCK, failures_per_10
from services.wire.messages import EpisodeSummary

WINDOW = 10
"""Episodes in the moving average."""
SIZE_INCH = (9.0, 5.0)
DOTS_PER_INCH = 100
BLACK, BLUE, SKY, VERMILION = "#000000", "#0072B2", "#56B4E9", "#D55E00"
BAND_PERCENT = (5.0, 95.0)

Episodes = Mapping[int, Sequence[EpisodeSummary]]
"""Episodes of each seed, in order, equally many of every seed."""


class _Curve(NamedTuple):
    file: str
    title: str
    axis: str
    field: str


_CURVES = (
    _Curve("return.png", "Return", "return of the episode", "episode_return"),
    _Curve("force.png", "Mean force", "mean force [N]", "mean_force_n"),
    _Curve("torque.png", "Mean torque", "mean torque [N·m]", "mean_torque_nm"),
)


def figures(experiment: str, episodes: Episodes) -> dict[str, bytes]:
    """Return the PNG images (900 x 500) return.png, force.png, torque.png and failures.png, by file name.

    Raises ValueError when there are no episodes, or not equally many of every seed.
    """
    lengths = {seed: len(of_seed) for seed, of_seed in episodes.items()}
    if len(set(lengths.values())) != 1 or 0 in lengths.values():
        raise ValueError(f"figures: expected equally many episodes of every seed, got {lengths}")
    seeds = f"seed {next(iter(lengths))}" if len(lengths) == 1 else f"{len(lengths)} seeds"
    where = f"{experiment}, {seeds}"
    images = {}
    for curve in _CURVES:
        values = np.array([[getattr(summary, curve.field) for summary in of_seed] for of_seed in episodes.values()])
        images[curve.file] = _png(_curve_figure(curve, where, values))
    failures = np.array([failures_per_10(of_seed) for of_seed in episodes.values()])
    images["failures.png"] = _png(_failure_figure(where, failures))
    return images


def moving_average(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean of each value and up to nine before it, along the last axis; same shape."""
    means = np.empty(values.shape, dtype=np.float64)
    for end in range(1, values.shape[-1] + 1):
        means[..., end - 1] = values[..., max(0, end - WINDOW) : end].mean(axis=-1)
    return means


def _curve_figure(curve: _Curve, where: str, values: NDArray[np.float64]) -> Figure:
    """Draw one quantity, shape (seeds, episodes)."""
    figure, axes = _blank(curve.title, where, curve.axis)
    episode = np.arange(values.shape[1])
    means = moving_average(values)
    # A run of a few episodes would be an invisible line without its points.
    marker = "o" if values.shape[1] <= WINDOW else None
    if len(values) == 1:
        axes.plot(episode, values[0], color=SKY, linewidth=0.8, alpha=0.7, marker=marker, label="each episode")
        axes.plot(episode, means[0], color=BLUE, linewidth=2.2, label=f"mean of the last {WINDOW} episodes")
    else:
        low, middle, high = np.percentile(means, (BAND_PERCENT[0], 50.0, BAND_PERCENT[1]), axis=0)
        axes.fill_between(episode, low, high, color=SKY, alpha=0.4, linewidth=0, label="5 % to 95 % of the seeds")
        label = f"median over the seeds of the mean of the last {WINDOW} episodes"
        axes.plot(episode, middle, color=BLUE, linewidth=2.2, marker=marker, label=label)
    axes.set_xlim(-0.5, values.shape[1])
    if curve.field != "episode_return":
        axes.set_ylim(0, 1.1 * axes.dataLim.y1 or 1.0)
    _legend(figure)
    return figure


def _failure_figure(where: str, failures: NDArray[np.int64]) -> Figure:
    """Draw the failures in each block of ten episodes, shape (seeds, blocks)."""
    figure, axes = _blank("Failures", where, f"failures in {BLOCK} episodes")
    blocks = failures.shape[1]
    middle = BLOCK * (np.arange(blocks) + 0.5) - 0.5
    low, median, high = np.percentile(failures, (BAND_PERCENT[0], 50.0, BAND_PERCENT[1]), axis=0)
    label = "failures" if len(failures) == 1 else "median over the seeds"
    axes.bar(middle, median, width=0.8 * BLOCK, color=VERMILION, label=label)
    if len(failures) > 1:
        width = min(1.5, 300.0 / blocks)
        axes.vlines(middle, low, high, color=BLACK, linewidth=width, label="5 % to 95 % of the seeds")
    axes.set_xlim(-0.5, BLOCK * blocks)
    axes.set_ylim(0, BLOCK)
    _legend(figure)
    return figure


def _blank(title: str, where: str, axis: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=SIZE_INCH, dpi=DOTS_PER_INCH, layout=ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.06))
    axes = figure.add_subplot()
    axes.set_title(title, loc="left", fontsize=16, fontweight="bold")
    axes.set_title(where, loc="right", fontsize=11)
    axes.set_xlabel("episode", fontsize=12)
    axes.set_ylabel(axis, fontsize=12)
    axes.tick_params(labelsize=11)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
    axes.grid(axis="y", color="#D9D9D9", linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return figure, axes


def _legend(figure: Figure) -> None:
    # Below the axes: inside, it would lie on the data of one experiment or another.
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=11)


def _png(figure: Figure) -> bytes:
    content = io.BytesIO()
    figure.savefig(content, format="png")
    return content.getvalue()
