"""The study in one picture: failures and force by episode, as the learners come and tuned, a pair of columns a task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from experiments.deep.methods import Method
from experiments.evaluate.controllers import RULE, RULES
from experiments.lab import bands
from experiments.leaderboard.figures import INSERTED
from experiments.leaderboard.jobs import Outcome
from experiments.leaderboard.methods import TREENAIL

ALGORITHMS = ("DQN", "PPO", "SAC", "RecurrentPPO")
PANEL_INCH = (4.3, 2.6)
LOOKS = {name: bands.style(number + 1) for number, name in enumerate(ALGORITHMS)}
OWN = bands.style(0)

Curves = Mapping[str, Sequence[Outcome]]
"""Outcomes of each seed, by method."""


def picture(tasks: Mapping[str, Curves], methods: Sequence[Method]) -> bytes:
    """Return a PNG image; a task has what was run of the methods, of Treenail's own learner and of the rules."""
    groups = [group for group in (_some(methods, tuned=False), _some(methods, tuned=True)) if group[1]]
    columns = [(task, title, some) for task in tasks for title, some in groups]
    size = (max(PANEL_INCH[0] * len(columns), 6.0), 2 * PANEL_INCH[1] + 0.6)
    figure = Figure(figsize=size, layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06))
    panels = figure.subplots(2, len(columns), squeeze=False, sharey="row")
    for place, (task, title, some) in enumerate(columns):
        failures, force = panels[0][place], panels[1][place]
        _draw(failures, force, tasks[task], some)
        failures.set_title(f"{task.removeprefix('suite-')}, {title}", loc="left", fontsize=10, fontweight="bold")
        force.set_xlabel("episode", fontsize=9)
        for axes in (failures, force):
            bands.tidy(axes)
    panels[0][0].set_ylabel("failures of 10 [%]", fontsize=9)
    panels[1][0].set_ylabel("mean force [N]", fontsize=9)
    for force in panels[1]:
        bands.logarithmic(force)
    bands.legend(figure, list(panels.flat), columns=6)
    return bands.png(figure)


def _some(methods: Sequence[Method], tuned: bool) -> tuple[str, list[Method]]:
    return "tuned" if tuned else "as they come", [method for method in methods if bool(method.settings) == tuned]


def _draw(failures: Axes, force: Axes, curves: Curves, methods: Sequence[Method]) -> None:
    looks = {TREENAIL: (OWN, TREENAIL)} | {
        method.name: (LOOKS[method.algorithm], method.algorithm) for method in methods
    }
    for name, (look, label) in looks.items():
        if not curves.get(name):
            continue
        failed = np.array([[float(end != INSERTED) for end in outcome.outcomes] for outcome in curves[name]])
        bands.rate(failures, failed, look, label)
        bands.band(force, np.array([outcome.force_n for outcome in curves[name]]), look, label)
    # Of the two rules the gentler, on both panels: the worse one would be a line that means nothing.
    rules = {name: curves[name] for name in RULES if curves.get(name)}
    if rules:
        name = min(rules, key=lambda rule: _mean([outcome.force_n for outcome in rules[rule]]))
        share = _mean([[float(end != INSERTED) for end in outcome.outcomes] for outcome in rules[name]])
        force_n = _mean([outcome.force_n for outcome in rules[name]])
        for axes, level in ((failures, 100.0 * share), (force, force_n)):
            axes.axhline(level, color=bands.BLACK.colour, linewidth=1.3, linestyle=":", label=RULE)
    failures.set_ylim(-2.0, 102.0)


def _mean(of_seeds: Sequence[Sequence[float]]) -> float:
    return float(np.mean([value for values in of_seeds for value in values]))
