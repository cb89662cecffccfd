"""Curves and figures of any runs beside each other, from the folders that ``treenail experiment run`` writes."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from rich import box
from rich.table import Table

from experiments.lab import bands, result_files
from experiments.leaderboard.figures import FIRST, INSERTED, Figures, figures
from experiments.leaderboard.jobs import Outcome, outcome
from experiments.leaderboard.page import percent
from services.wire.errors import TreenailError

SIZE_INCH = (10.0, 6.4)
SEEN_PERCENT = (1.0, 97.0)
"""Part of what the curves reach that an axis shows: a few first episodes are often ten times the rest."""


class Runs(NamedTuple):
    """The runs of one folder."""

    label: str
    experiment: str
    outcomes: dict[int, Outcome]
    """By seed, each as long as the others."""

    @property
    def figures(self) -> Figures:
        """What they come to."""
        return figures(self.outcomes, learns=True)


def read(folders: Sequence[Path]) -> list[Runs]:
    """Return what is in folders of results. Raises ResultsError, and TreenailError for a folder given twice."""
    if len({folder.resolve() for folder in folders}) != len(folders):
        raise TreenailError("compare: expected every folder once, got one twice")
    labels = _labels(folders)
    return [_runs(folder, label) for folder, label in zip(folders, labels, strict=True)]


def picture(compared: Sequence[Runs]) -> bytes:
    """Return a PNG image of failures, force, moves and return by episode, a colour a folder, with bands over seeds."""
    figure = Figure(figsize=SIZE_INCH, layout=ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.08))
    panels: list[Axes] = list(figure.subplots(2, 2).flat)
    failures, *others = panels
    for number, runs in enumerate(compared):
        failed = np.array([[float(end != INSERTED) for end in of.outcomes] for of in runs.outcomes.values()])
        bands.rate(failures, failed, bands.style(number), runs.label)
    for axes, field in zip(others, ("force_n", "moves", "returns"), strict=True):
        drawn = list[float]()
        for number, runs in enumerate(compared):
            values = np.array([getattr(of, field) for of in runs.outcomes.values()], dtype=np.float64)
            bands.band(axes, values, bands.style(number), runs.label)
            drawn += np.percentile(bands.moving_average(values), SEEN_PERCENT).tolist()
        margin = 0.08 * (max(drawn) - min(drawn)) or 0.5
        axes.set_ylim(min(drawn) - margin if field == "returns" else 0.0, max(drawn) + margin)
    failures.set_ylim(-2.0, 102.0)
    for axes, title in zip(panels, ("failures of 10 [%]", "mean force [N]", "moves", "return"), strict=True):
        axes.set_title(title, loc="left", fontsize=11, fontweight="bold")
        axes.set_xlabel("episode", fontsize=10)
        bands.tidy(axes)
    bands.legend(figure, panels[:1], columns=1 if len(compared) < 3 else 2)
    return bands.png(figure)


def table(compared: Sequence[Runs]) -> Table:
    """Return the figures for people: a row a folder."""
    caption = (
        f"first: failures in the first {FIRST} episodes, median (most) of the seeds; the rest is of the last third"
    )
    shown = Table(caption=f"{caption}, 100 episodes at most", caption_justify="left", box=box.SIMPLE_HEAD)
    shown.pad_edge, shown.collapse_padding = False, True  # so that it fits 80 columns
    shown.add_column("runs", overflow="fold")
    for column in ("seeds", "episodes", "first", "success [%]", "force", "moves", "steady"):
        shown.add_column(column, justify="right", no_wrap=True)
    for runs in compared:
        shown.add_row(runs.label, *_cells(runs.figures))
    return shown


def as_json(compared: Sequence[Runs]) -> Mapping[str, object]:
    """Return the figures by label."""
    return {runs.label: {"experiment": runs.experiment, "figures": runs.figures} for runs in compared}


def _runs(folder: Path, label: str) -> Runs:
    if not folder.is_dir():
        raise result_files.ResultsError(f"{folder}: expected a folder that `treenail experiment run` wrote, got none")
    read = result_files.read_episodes(folder / result_files.EPISODES)
    in_step = result_files.in_step(read.episodes)
    return Runs(label, read.experiment, {seed: outcome(episodes) for seed, episodes in in_step.items()})


def _labels(folders: Sequence[Path]) -> list[str]:
    """Return the shortest ends of paths that tell them apart."""
    parts = [folder.resolve().parts for folder in folders]
    for length in range(1, max(map(len, parts)) + 1):
        labels = ["/".join(path[-length:]) for path in parts]
        if len(set(labels)) == len(labels):
            return labels
    raise AssertionError("different folders have different paths")


def _cells(made: Figures) -> list[str]:
    steady = sorted(float("inf") if begin is None else begin for begin in made["steady_from"])
    median = statistics.median_low(steady)
    return [
        str(len(made["seeds"])),
        str(made["episodes"]),
        f"{made['first_failures_median']:g} ({made['first_failures_most']})",
        f"{percent(made['success'])} ({percent(made['success_low'])} to {percent(made['success_high'])})",
        f"{made['force_n']['mean']:.2f}",
        "none" if made["moves"] is None else f"{made['moves']['mean']:.0f}",
        "never" if median == float("inf") else f"{median:g}",
    ]
