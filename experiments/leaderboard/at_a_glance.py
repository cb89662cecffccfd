"""The board in one picture: force at the end, and failures in the first episodes, a row a task."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from experiments.evaluate.controllers import RULE
from experiments.lab import bands
from experiments.leaderboard.board import Board, best_rule
from experiments.leaderboard.figures import FIRST, Figures

MARKS = {"treenail": ("o", "#0072B2"), "table": ("s", "#E69F00"), RULE: ("|", "#000000"), "oracle": ("*", "#009E73")}
"""Methods that are drawn, and how; random moves would push all others into a corner."""
WIDTH_INCH, ROW_INCH = 9.0, 0.30
TICKS_N = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
GREY = "#BBBBBB"


def picture(board: Board) -> bytes | None:
    """Return a PNG image, None where nothing was run that is drawn."""
    rows = {task: drawn for task in board.tasks if (drawn := _drawn(board, task))}
    if not rows:
        return None
    figure = Figure(
        figsize=(WIDTH_INCH, ROW_INCH * len(rows) + 1.3), layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.04)
    )
    force, failures = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    for place, of_task in enumerate(rows.values()):
        _force(force, place, of_task)
        _failures(failures, place, of_task)
    force.set_xscale("log")
    force.xaxis.set_major_locator(FixedLocator(TICKS_N))
    force.xaxis.set_minor_locator(NullLocator())
    force.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    force.set_yticks(range(len(rows)), [task.removeprefix("suite-") for task in rows])
    force.set_ylim(len(rows) - 0.5, -0.5)
    force.set_title("mean force at the end [N]", loc="left", fontsize=11, fontweight="bold")
    failures.set_xlim(-0.5, FIRST + 0.5)
    failures.set_title(f"failures in the first {FIRST}", loc="left", fontsize=11, fontweight="bold")
    for axes in (force, failures):
        axes.grid(axis="x", color="#E3E3E3", linewidth=0.8)
        axes.set_axisbelow(True)
        axes.tick_params(axis="y", length=0)
        for side in ("top", "right", "left"):
            axes.spines[side].set_visible(False)
    bands.legend(figure, [force], columns=len(MARKS))
    return bands.png(figure)


def _drawn(board: Board, task: str) -> dict[str, Figures]:
    """Return what is drawn of a task; the rule is the better of the hand-written ones."""
    rows = {(task, row["method"]): row["figures"] for row in board.rows if row["task"] == task and row["figures"]}
    made = {place: figures for place, figures in rows.items() if figures is not None}
    drawn = {name: made[task, name] for name in MARKS if (task, name) in made}
    rule = best_rule(task, made)
    return drawn if rule is None else {**drawn, RULE: rule}


def _force(axes: Axes, place: int, of_task: Mapping[str, Figures]) -> None:
    """Draw what each presses with; a white mark is one that does not succeed in 99 % at the end."""
    means = [figures["force_n"]["mean"] for figures in of_task.values()]
    axes.plot([min(means), max(means)], [place, place], color=GREY, linewidth=1.2, zorder=1)
    for name, figures in of_task.items():
        shape, colour = MARKS[name]
        sound = figures["success"] >= 0.99 or shape == "|"
        axes.scatter(
            figures["force_n"]["mean"],
            place,
            marker=shape,
            s=130 if shape == "|" else 62,
            linewidths=2.2 if shape == "|" else 1.5,
            edgecolors=None if shape == "|" else colour,
            facecolors=colour if sound else "white",
            zorder=3,
            label=name,
        )


def _failures(axes: Axes, place: int, of_task: Mapping[str, Figures]) -> None:
    """Draw the median of the seeds, and a line to the most."""
    for name, offset in (("treenail", -0.13), ("table", 0.13)):
        if name in of_task:
            shape, colour = MARKS[name]
            median, most = of_task[name]["first_failures_median"], of_task[name]["first_failures_most"]
            axes.plot([median, most], [place + offset] * 2, color=colour, linewidth=1.4, zorder=2)
            axes.scatter(median, place + offset, marker=shape, s=40, color=colour, zorder=3)
