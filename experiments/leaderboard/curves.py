"""The pictures of a board: failures and force by episode, a panel a task."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from experiments.evaluate.controllers import RULE
from experiments.lab import bands
from experiments.leaderboard.figures import INSERTED
from experiments.leaderboard.jobs import Outcome

COLUMNS = 4
PANEL_INCH = (3.2, 2.3)
LEAST_INCH = (7.0, 2.9)
"""Of a picture, without its legend."""
LEGEND_COLUMN_INCH, LEGEND_ROW_INCH = 1.7, 0.22
MOST_TIMES = 8.0
"""Where one method presses so many times as hard as another, forces are on a logarithmic scale."""
SEEN_PERCENT = 98.0
"""Part of a panel's force that its axis shows: a few first episodes are often ten times the rest."""

Curves = Mapping[str, Mapping[str, Sequence[Outcome]]]
"""Outcomes of each seed, by task and method."""
_Draw = Callable[
    [Axes, Mapping[str, Sequence[Outcome]], Mapping[str, Sequence[Outcome]], Mapping[str, bands.Style]], None
]


def pictures(board: str, learners: Curves, baselines: Curves) -> dict[str, bytes]:
    """Return <board>-failures.png and <board>-force.png; methods that do not learn are level lines, their mean."""
    tasks = [task for task in learners if learners[task]]
    if not tasks:
        return {}
    names = list(dict.fromkeys(name for task in tasks for name in (*learners[task], *baselines.get(task, {}))))
    looks = {name: bands.style(number) for number, name in enumerate(names)} | {RULE: bands.BLACK}
    return {
        f"{board}-failures.png": _grid(tasks, learners, baselines, looks, "failures of 10 [%]", _failures),
        f"{board}-force.png": _grid(tasks, learners, baselines, looks, "mean force [N]", _forces),
    }


def _grid(
    tasks: Sequence[str],
    learners: Curves,
    baselines: Curves,
    looks: Mapping[str, bands.Style],
    axis: str,
    draw: _Draw,
) -> bytes:
    columns = min(COLUMNS, len(tasks))
    rows = math.ceil(len(tasks) / columns)
    width, height = max(PANEL_INCH[0] * columns, LEAST_INCH[0]), max(PANEL_INCH[1] * rows, LEAST_INCH[1])
    legend_columns = int(width / LEGEND_COLUMN_INCH)
    height += LEGEND_ROW_INCH * (1 + math.ceil(len(looks) / legend_columns))
    figure = Figure(figsize=(width, height), layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06))
    panels: list[Axes] = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axes in panels[len(tasks) :]:
        axes.set_axis_off()
    for number, (axes, task) in enumerate(zip(panels, tasks, strict=False)):
        draw(axes, learners[task], baselines.get(task, {}), looks)
        axes.set_title(task.removeprefix("suite-"), loc="left", fontsize=10, fontweight="bold")
        bands.tidy(axes)
        if number % columns == 0:
            axes.set_ylabel(axis, fontsize=9)
        if number >= len(tasks) - columns:
            axes.set_xlabel("episode", fontsize=9)
    bands.legend(figure, panels[: len(tasks)], legend_columns)
    return bands.png(figure)


def _failures(
    axes: Axes,
    learners: Mapping[str, Sequence[Outcome]],
    baselines: Mapping[str, Sequence[Outcome]],
    looks: Mapping[str, bands.Style],
) -> None:
    for name, outcomes in learners.items():
        each = np.array([[float(end != INSERTED) for end in outcome.outcomes] for outcome in outcomes])
        bands.rate(axes, each, looks[name], name)
    for name, outcomes in baselines.items():
        failed = np.mean([end != INSERTED for outcome in outcomes for end in outcome.outcomes])
        axes.axhline(100.0 * float(failed), color=looks[name].colour, linewidth=1.3, linestyle=":", label=name)
    axes.set_ylim(-2.0, 102.0)


def _forces(
    axes: Axes,
    learners: Mapping[str, Sequence[Outcome]],
    baselines: Mapping[str, Sequence[Outcome]],
    looks: Mapping[str, bands.Style],
) -> None:
    seen, usual = [0.1], list[float]()
    for name, outcomes in learners.items():
        each = np.array([outcome.force_n for outcome in outcomes])
        bands.band(axes, each, looks[name], name)
        smooth = bands.moving_average(each)
        seen.append(float(np.percentile(smooth, SEEN_PERCENT)))
        usual.append(float(np.median(smooth)))
    for name, outcomes in baselines.items():
        force_n = float(np.mean([value for outcome in outcomes for value in outcome.force_n]))
        axes.axhline(force_n, color=looks[name].colour, linewidth=1.3, linestyle=":", label=name)
        seen.append(force_n if name != "random" else 0.0)
    if usual and min(usual) > 0.0 and max(usual) > MOST_TIMES * min(usual):
        bands.logarithmic(axes)
        axes.set_ylim(0.7 * min(usual), 1.5 * max(seen))
    else:
        axes.set_ylim(0.0, 1.05 * max(seen))
