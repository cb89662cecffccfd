"""The thesis's four figures: return, mean force, mean torque and failures over the episodes (Figs. 6.6-6.10).

One seed is drawn as it is: every episode thin, the mean of the last ten on top. Several seeds are drawn as the median
of those means with a band from the 5th to the 95th percentile. Beside the whole run stands its last quarter with an
axis of its own, since the first episodes are often a hundred times worse than the last. Marks at the foot are episodes
that ended in a collision, and a dotted line is what the thesis says of the experiment, where it does. Colours are Okabe
and Ito's, told apart by everyone.
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

from experiments.reproduce.insertion_thesis import REPORTED, Said
from services.rules.results import BLOCK, failures_per_10
from services.wire.messages import EpisodeSummary

WINDOW = 10
"""Episodes in the moving average."""
SIZE_INCH = (9.0, 5.0)
DOTS_PER_INCH = 100
BLACK, BLUE, SKY, VERMILION, GREEN = "#000000", "#0072B2", "#56B4E9", "#D55E00", "#009E73"
BAND_PERCENT = (5.0, 95.0)
SHORT = 20
"""Runs of fewer episodes are drawn without their last quarter."""

Episodes = Mapping[int, Sequence[EpisodeSummary]]
"""Episodes of each seed, in order, equally many of every seed."""


class _Curve(NamedTuple):
    file: str
    title: str
    axis: str
    field: str
    reported: str
    """What the thesis reports of it, as a field of ``Reported``."""


_CURVES = (
    _Curve("return.png", "Return", "return of the episode", "episode_return", "episode_return"),
    _Curve("force.png", "Mean force", "mean force [N]", "mean_force_n", "force_n"),
    _Curve("torque.png", "Mean torque", "mean torque [N·m]", "mean_torque_nm", "torque_nm"),
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
    collisions = np.array([[summary.outcome == "collision" for summary in of_seed] for of_seed in episodes.values()])
    images = {}
    for curve in _CURVES:
        values = np.array([[getattr(summary, curve.field) for summary in of_seed] for of_seed in episodes.values()])
        drawn = _curve_figure(curve, where, values, collisions, thesis(experiment, curve.reported))
        images[curve.file] = _png(drawn)
    failures = np.array([failures_per_10(of_seed) for of_seed in episodes.values()])
    images["failures.png"] = _png(_failure_figure(where, failures))
    return images


def moving_average(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean of each value and up to nine before it, along the last axis; same shape."""
    means = np.empty(values.shape, dtype=np.float64)
    for end in range(1, values.shape[-1] + 1):
        means[..., end - 1] = values[..., max(0, end - WINDOW) : end].mean(axis=-1)
    return means


def thesis(experiment: str, reported: str) -> float | None:
    """Return what the thesis says of a shipped experiment once it is steady, None where it says nothing of our task."""
    for figures in REPORTED:
        if figures.name == experiment and not figures.apart:
            said: Said | None = getattr(figures, reported)
            return None if said is None else said.value
    return None


def _curve_figure(
    curve: _Curve,
    where: str,
    values: NDArray[np.float64],
    collisions: NDArray[np.bool_],
    told: float | None,
) -> Figure:
    """Draw one quantity, ``values`` and ``collisions`` of shape (seeds, episodes); ``told`` is the thesis's number."""
    episodes = values.shape[1]
    figure, panels = _blank(curve.title, where, curve.axis, columns=1 if episodes < SHORT else 2)
    for axes in panels:
        _draw(axes, values)
        if told is not None:
            axes.axhline(told, color=GREEN, linewidth=1.5, linestyle=":", label=f"the thesis, steady: {told:g}")
        _mark(axes, collisions)
    whole, *late = panels
    whole.set_xlim(-0.5, episodes)
    if curve.field != "episode_return":
        whole.set_ylim(0, 1.1 * max(whole.dataLim.y1, told or 0.0) or 1.0)
    for axes in late:
        axes.set_title("last quarter", loc="left", fontsize=11)
        axes.set_xlim(episodes - episodes // 4 - 0.5, episodes)
        axes.set_ylim(readable(values[:, -(episodes // 4) :], told))
    _legend(figure, whole)
    return figure


def _draw(axes: Axes, values: NDArray[np.float64]) -> None:
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


def _mark(axes: Axes, collisions: NDArray[np.bool_]) -> None:
    """Mark the episodes that ended in a collision at the foot; the paler, the fewer seeds."""
    times = np.flatnonzero(collisions.any(axis=0))
    if times.size:
        axes.scatter(
            times,
            np.full(times.size, 0.015),
            s=28,
            marker="|",
            color=VERMILION,
            alpha=np.maximum(collisions.mean(axis=0)[times], 0.15),
            transform=axes.get_xaxis_transform(),
            zorder=3,
            label="ended in a collision",
        )


def readable(values: NDArray[np.float64], told: float | None) -> tuple[float, float]:
    """Return limits for an axis that shows nine tenths of values and means, and the thesis's; rare failures run off."""
    ranges = np.percentile(values, BAND_PERCENT), np.percentile(moving_average(values), BAND_PERCENT)
    shown = [*np.concatenate(ranges).tolist(), *(() if told is None else (told,))]
    low, high = min(shown), max(shown)
    margin = 0.15 * (high - low) or 0.1 * abs(high) or 1.0
    return low - margin, high + margin


def _failure_figure(where: str, failures: NDArray[np.int64]) -> Figure:
    """Draw the failures in each block of ten episodes, shape (seeds, blocks)."""
    figure, (axes,) = _blank("Failures", where, f"failures in {BLOCK} episodes")
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
    _legend(figure, axes)
    return figure


def _blank(title: str, where: str, axis: str, columns: int = 1) -> tuple[Figure, list[Axes]]:
    """Return a figure and its panels from left to right."""
    figure = Figure(figsize=SIZE_INCH, dpi=DOTS_PER_INCH, layout=ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.06))
    panels: list[Axes] = list(figure.subplots(1, columns, squeeze=False, width_ratios=(2, 1)[:columns])[0])
    panels[0].set_title(title, loc="left", fontsize=16, fontweight="bold")
    panels[0].set_title(where, loc="right", fontsize=11)
    panels[0].set_ylabel(axis, fontsize=12)
    for axes in panels:
        axes.set_xlabel("episode", fontsize=12)
        axes.tick_params(labelsize=11)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
        axes.grid(axis="y", color="#D9D9D9", linewidth=0.8)
        axes.set_axisbelow(True)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    return figure, panels


def _legend(figure: Figure, axes: Axes) -> None:
    # Below the axes: inside, it would lie on the data of one experiment or another.
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False, fontsize=11)


def _png(figure: Figure) -> bytes:
    content = io.BytesIO()
    figure.savefig(content, format="png")
    return content.getvalue()
