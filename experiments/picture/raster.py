"""Triangles to pixels with a depth buffer, in NumPy alone: pictures need no display, graphics card or driver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Pixels = npt.NDArray[np.uint8]
Colour = tuple[int, int, int]

AMBIENT = 0.35
"""Part of a surface's colour that needs no light."""
_LIGHT = np.array([0.35, -0.8, -0.5]) / np.linalg.norm([0.35, -0.8, -0.5])
_EDGE = 1e-9


@dataclass(frozen=True)
class Camera:
    """Where a scene is looked at from; perspective, all lengths in mm of the scene's frame."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float]
    across_mm: float
    """Width of what is seen at the distance of ``target``."""
    wide: int
    """Pixels."""
    high: int

    def project(self, points: npt.ArrayLike) -> Floats:
        """Return where points are on the screen: x and y [pixels, y down] and depth [mm], shape (n, 3)."""
        forward = np.subtract(self.target, self.eye).astype(np.float64)
        distance = float(np.linalg.norm(forward))
        forward /= distance
        right = np.cross(forward, self.up)
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(forward, right), forward])
        seen = (np.asarray(points, dtype=np.float64).reshape(-1, 3) - self.eye) @ axes.T
        scale = self.wide / self.across_mm * distance / seen[:, 2:]
        return np.hstack([seen[:, :2] * scale + (self.wide / 2, self.high / 2), seen[:, 2:]])


class Canvas:
    """Pixels with a depth each; what is nearer hides what is behind it."""

    def __init__(self, camera: Camera, background: Colour) -> None:
        self.camera = camera
        self.pixels: Pixels = np.empty((camera.high, camera.wide, 3), dtype=np.uint8)
        self.pixels[...] = background
        self._depth: Floats = np.full((camera.high, camera.wide), np.inf)

    def copy(self) -> Canvas:
        """Return a canvas with the same on it, to draw more on."""
        other = Canvas(self.camera, (0, 0, 0))
        other.pixels, other._depth = self.pixels.copy(), self._depth.copy()
        return other

    def draw(self, corners: npt.ArrayLike, normals: npt.ArrayLike, colour: Colour, opacity: float = 1.0) -> None:
        """Draw triangles, of one colour in parallel light from the front.

        ``corners``, shape (3 n, 3), and ``normals`` of the same shape as in ``services.viewer.shapes.Mesh``. With an
        opacity below 1 what is behind shines through, but never one of these triangles through another.
        """
        nearest = self._depth.copy()
        shade = np.zeros_like(nearest)
        on_screen = self.camera.project(corners).reshape(-1, 3, 3)
        facing = np.abs(np.asarray(normals, dtype=np.float64).reshape(-1, 3, 3)[:, 0] @ _LIGHT)
        for triangle, light in zip(on_screen, AMBIENT + (1.0 - AMBIENT) * facing, strict=True):
            _fill(nearest, shade, triangle, float(light))
        drawn = nearest < self._depth
        painted = shade[drawn][:, None] * np.array(colour, dtype=np.float64)
        self.pixels[drawn] = (opacity * painted + (1.0 - opacity) * self.pixels[drawn]).round()
        if opacity == 1.0:
            self._depth = nearest


def _fill(depth: Floats, shade: Floats, triangle: Floats, light: float) -> None:
    """Put one triangle, rows (x, y, depth), where nothing is nearer."""
    high, wide = depth.shape
    left, top = np.floor(triangle[:, :2].min(axis=0)).astype(int)
    right, bottom = np.ceil(triangle[:, :2].max(axis=0)).astype(int) + 1
    left, top, right, bottom = max(left, 0), max(top, 0), min(right, wide), min(bottom, high)
    if left >= right or top >= bottom or (triangle[:, 2] <= 0.0).any():
        return
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = triangle
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if abs(area) < _EDGE:
        return
    x, y = np.arange(left, right)[None, :] + 0.5, np.arange(top, bottom)[:, None] + 0.5
    of_b = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
    of_c = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
    of_a = 1.0 - of_b - of_c
    # Along a straight line on the screen it is the inverse of the depth that changes evenly.
    here = 1.0 / (of_a / az + of_b / bz + of_c / cz)
    window = depth[top:bottom, left:right]
    nearer = (of_a >= 0.0) & (of_b >= 0.0) & (of_c >= 0.0) & (here < window)
    window[nearer] = here[nearer]
    shade[top:bottom, left:right][nearer] = light
