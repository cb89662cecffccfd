"""Drawings for the report: SVG that stands in the page itself and is legible on a light and on a dark one.

What matplotlib draws in ``INK`` takes the colour of the page's text; lines are in Okabe and Ito's colours, told apart
by everyone.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from experiments.reproduce.verdicts import BAND_PERCENT

BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY = "#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9"
COLOURS = (VERMILION, BLUE, GREEN, ORANGE, PURPLE, SKY)
INK = "#7f7f7e"
"""Stands for the colour of the text around; a grey that nothing else is drawn in."""
SIZE_INCH = (5.6, 3.2)
"""Small, so that its text is still of a readable size on a phone."""

_STYLE: dict[Any, Any] = {
    "figure.figsize": SIZE_INCH,
    "figure.constrained_layout.use": True,
    "font.size": 9.5,
    "axes.grid": True,
    "axes.prop_cycle": f"cycler('color', {list(COLOURS)})",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": "medium",
    "grid.alpha": 0.25,
    "grid.linewidth": 0.5,
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "svg.fonttype": "none",
    **dict.fromkeys(
        ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color", "grid.color"), INK
    ),
}


@contextmanager
def drawing(
    rows: int = 1, columns: int = 1, height_inch: float | None = None
) -> Iterator[tuple[Figure, NDArray[np.object_]]]:
    """Give a figure in the report's style and its axes, shape (rows, columns), while the style holds.

    Draw and call ``svg`` inside the ``with``.
    """
    with rc_context(_STYLE):
        width, height = SIZE_INCH
        figure = Figure(figsize=(width, height_inch or max(height, 2.3 * rows)))
        yield figure, figure.subplots(rows, columns, squeeze=False)


def svg(figure: Figure) -> str:
    """Return the drawing as an SVG element without background, addresses, scripts or styles for the whole page."""
    content = io.StringIO()
    # Names are made from the drawing and this salt: the same drawing gives the same text.
    with rc_context({"svg.hashsalt": "treenail"}):
        figure.savefig(content, format="svg", transparent=True, metadata={"Date": None})
    text = content.getvalue()
    text = text[text.index("<svg") :]
    for unwanted in (r"<metadata>.*?</metadata>", r"<style[^>]*>.*?</style>", r"<!--.*?-->", r' xmlns(:\w+)?="[^"]*"'):
        text = re.sub(unwanted, "", text, flags=re.DOTALL)
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text))
    text = text.replace("xlink:href", "href").replace(INK, "currentColor")
    # Hundredths of a point are fine enough for what is drawn; what is written stays as it is.
    return re.sub(r'="[^"]*"', lambda value: re.sub(r"(\d\.\d\d)\d+", r"\1", value.group()), text).strip()


def moving_average(values: NDArray[np.float64], window: int) -> NDArray[np.float64]:
    """Return the means of ``window`` successive values along the last axis, shape (..., n - window + 1)."""
    means: NDArray[np.float64] = np.lib.stride_tricks.sliding_window_view(values, window, axis=-1).mean(axis=-1)
    return means


def legend(places: Sequence[Axes]) -> None:
    """Name the lines of axes that share their colours, once: where most of them are, of equals in the last."""
    fullest = max(reversed(places), key=lambda axes: len(axes.lines))
    if fullest.lines:
        fullest.legend(loc="lower right")


def band(axes: Axes, x: Sequence[float], values: NDArray[np.float64], colour: str, label: str) -> None:
    """Draw the median over seeds with the 90 % interval as a band; ``values`` of shape (seeds, len(x))."""
    low, high = np.percentile(values, BAND_PERCENT, axis=0)
    axes.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0)
    axes.plot(x, np.median(values, axis=0), color=colour, label=label)
