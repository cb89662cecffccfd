"""Colours that people with any colour vision can tell apart."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Colour = tuple[int, int, int]
Pixels = npt.NDArray[np.uint8]

# The palette of Okabe and Ito (2008), without the black, which a dark background would swallow.
ORANGE: Colour = (230, 159, 0)
SKY_BLUE: Colour = (86, 180, 233)
GREEN: Colour = (0, 158, 115)
YELLOW: Colour = (240, 228, 66)
VERMILION: Colour = (213, 94, 0)
PURPLE: Colour = (204, 121, 167)
GREY: Colour = (150, 150, 150)

UNKNOWN: Colour = (60, 60, 60)
"""Stands for "no value": outside the map below."""

# Viridis at nine equal steps: lightness rises evenly from dark (least) to light (greatest).
_VIRIDIS = np.array(
    [
        (68, 1, 84),
        (71, 44, 122),
        (59, 81, 139),
        (44, 113, 142),
        (33, 144, 141),
        (39, 173, 129),
        (92, 200, 99),
        (170, 220, 50),
        (253, 231, 37),
    ],
    dtype=np.float64,
)


def viridis(values: npt.NDArray[np.float64], visited: npt.NDArray[np.bool_]) -> Pixels:
    """Return the colour of each value, from dark for the least of those shown to light for the greatest.

    Args:
        values: finite numbers, shape (rows, columns).
        visited: which of them to show; the others become UNKNOWN.

    Returns:
        Red, green, blue from 0 to 255, shape (rows, columns, 3).
    """
    pixels = np.empty((*values.shape, 3), dtype=np.uint8)
    pixels[...] = UNKNOWN
    if visited.any():
        shown = values[visited]
        least, greatest = float(shown.min()), float(shown.max())
        places = (shown - least) / ((greatest - least) or 1.0)
        steps = np.linspace(0.0, 1.0, len(_VIRIDIS))
        pixels[visited] = np.stack([np.interp(places, steps, channel) for channel in _VIRIDIS.T], axis=-1).round()
    return pixels


def stretched(pixels: Pixels, high: int, wide: int) -> Pixels:
    """Return an image, shape (rows, columns, 3), in ``high`` by ``wide`` pixels, its own repeated; sharp edges."""
    rows, columns, _ = pixels.shape
    down, across = np.arange(high) * rows // high, np.arange(wide) * columns // wide
    canvas: Pixels = pixels[down[:, None], across[None, :]]
    return canvas
