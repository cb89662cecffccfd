"""The figures of the chapter on learners (thesis Figs. 4.3, 4.4, 4.12, 4.14 to 4.21, A.1, A.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from experiments.reproduce.figures import (
    BLUE,
    COLOURS,
    GREEN,
    INK,
    ORANGE,
    VERMILION,
    band,
    drawing,
    moving_average,
    svg,
)
from experiments.reproduce.gridworlds import OFFSETS, Move
from services.agent.policies import probabilities
from services.wire.definition import EpsilonAnnealed, Softmax

WINDOW = 10
"""Episodes in a moving average, as in the thesis, and in a block of failures."""
SMOOTH = 50
"""Episodes in the moving average of Fig. 4.21, in place of the thesis's Bezier curve."""
LINE_STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))
"""So that curves are told apart without their colour."""
MUS = (0.001, 0.01, 0.1, 1.0, 10.0)
BETAS = (0.0, 0.5, 1.0, 2.0, 5.0)
VALUES = np.array([-4.0, -3.0, -2.0, -1.0, 0.0])
"""Action values made up for Fig. 4.4."""


def epsilon(mu: float, episode: int) -> float:
    """Return the part of blind choices that the agent's own policy makes in an episode, from eq. 4.1 solved for it."""
    best = float(probabilities(np.array([1.0, 0.0, 0.0, 0.0]), EpsilonAnnealed(mu=mu), episode)[0])
    return (1.0 - best) * 4.0 / 3.0


def epsilon_schedule(episodes: int = 500) -> str:
    """Fig. 4.3: epsilon over the episodes for several mu."""
    with drawing() as (figure, ((axes,),)):
        for mu, colour, style in zip(MUS, COLOURS, LINE_STYLES, strict=False):
            curve = [epsilon(mu, episode) for episode in range(episodes)]
            axes.plot(curve, color=colour, linestyle=style, label=f"μ = {mu:g}")
        axes.set(xlabel="episode", ylabel="ε", ylim=(0, 1.02), xlim=(0, episodes))
        axes.legend(loc="upper right", bbox_to_anchor=(1.0, 0.64))
        return svg(figure)


def gibbs() -> str:
    """Fig. 4.4: the Gibbs distribution over actions of made-up values for several beta."""
    with drawing() as (figure, ((axes,),)):
        for beta, colour, style in zip(BETAS, COLOURS, LINE_STYLES, strict=False):
            chances = probabilities(VALUES, Softmax(beta=beta, beta_per_episode=0.0), 0)
            axes.plot(VALUES, chances, color=colour, linestyle=style, marker="o", markersize=4, label=f"β = {beta:g}")
        axes.set(xlabel="value of the action", ylabel="probability of the action", ylim=(0, 1.02), xticks=VALUES)
        axes.legend(loc="upper left")
        return svg(figure)


def worlds(layouts: Mapping[str, tuple[str, str]]) -> str:
    """Draw layouts side by side, by title, each with a path from its start such as ``SSEE``."""
    rows, columns = next((len(lines), len(lines[0])) for layout, _ in layouts.values() if (lines := layout.split()))
    with drawing(columns=len(layouts), height_inch=0.4 + 2.7 * rows / columns) as (figure, (all_axes,)):
        for axes, (title, (layout, path)) in zip(all_axes, layouts.items(), strict=True):
            _world(axes, layout.split(), path)
            axes.set_title(title)
        return svg(figure)


def _world(axes: Axes, lines: Sequence[str], path: str) -> None:
    at = (0, 0)
    for row, line in enumerate(lines):
        for column, square in enumerate(line):
            shade = {"#": 0.55, "x": 0.25}.get(square, 0.0)
            axes.add_patch(
                Rectangle((column, row), 1, 1, facecolor=(0.5, 0.5, 0.5, shade), edgecolor=INK, linewidth=0.5)
            )
            if square in "SG":
                axes.text(column + 0.5, row + 0.5, square, ha="center", va="center", fontweight="bold", zorder=3)
            if square == "S":
                at = (row, column)
    walked = [at]
    for letter in path:
        rows, columns = OFFSETS[next(move for move in Move if move.name[0] == letter)]
        walked.append((walked[-1][0] + rows, walked[-1][1] + columns))
    y, x = np.array(walked).T + 0.5
    axes.plot(x, y, color=VERMILION, linestyle="--", linewidth=1.2, alpha=0.8)
    axes.set(xlim=(-0.02, len(lines[0]) + 0.02), ylim=(len(lines) + 0.02, -0.02), aspect="equal")
    axes.axis("off")


def learning(
    curves: Mapping[str, NDArray[np.float64]],
    floor: float,
    levels: Mapping[str, float],
    window: int = WINDOW,
    colours: Sequence[str] = COLOURS,
) -> str:
    """Figs. 4.14 to 4.21, A.1, A.2: returns by name, each of shape (seeds, episodes), down to ``floor``.

    Of a single curve its first seed is drawn as well. ``levels`` are returns of one or two paths, by name.
    """
    with drawing() as (figure, ((axes,),)):
        for (label, returns), colour, style in zip(curves.items(), colours, LINE_STYLES, strict=False):
            averages = moving_average(returns, window)
            ends = [float(end) for end in range(window, window + averages.shape[1])]
            band(axes, ends, averages, colour, label)
            axes.lines[-1].set_linestyle(style)
            if len(curves) == 1:
                axes.plot(ends, averages[0], color=INK, linewidth=0.6, alpha=0.7, label="seed 0")
            axes.set_xlim(0, returns.shape[1])
        for (label, level), colour in zip(levels.items(), (GREEN, ORANGE), strict=False):
            axes.axhline(level, color=colour, linewidth=1, linestyle=":", label=label)
        axes.set(xlabel="episode", ylabel="return", ylim=(floor, 10))
        figure.legend(loc="outside lower center", ncols=3)
        return svg(figure)


def failures(falls: NDArray[np.float64], colour: str) -> str:
    """Figs. 4.18, 4.20: falls in each ten episodes; ``falls`` of shape (seeds, episodes), 1 for a fall."""
    blocks = falls.reshape(len(falls), -1, WINDOW).sum(axis=2)
    with drawing() as (figure, ((axes,),)):
        ends = WINDOW * np.arange(blocks.shape[1])
        axes.bar(ends, blocks[0], WINDOW, align="edge", color=INK, alpha=0.6, label="seed 0")
        axes.plot(ends + WINDOW / 2, blocks.mean(axis=0), color=colour, label="mean of the seeds")
        axes.set(xlabel="episode", ylabel="falls per 10 episodes", ylim=(0, WINDOW), xlim=(0, falls.shape[1]))
        axes.legend(loc="upper right")
        return svg(figure)


def both(sarsa: NDArray[np.float64], q_learning: NDArray[np.float64], floor: float, levels: Mapping[str, float]) -> str:
    """Fig. 4.21: both learners, smoothed."""
    return learning({"SARSA": sarsa, "Q-learning": q_learning}, floor, levels, SMOOTH, (BLUE, VERMILION))
