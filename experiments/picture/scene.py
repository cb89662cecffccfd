"""An insertion as pictures: peg and hole from the side that is cut open, the force as an arrow, and its curve below."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from experiments.picture.raster import Camera, Canvas, Colour, Floats, Pixels
from services.sim.pose import Pose, rotate
from services.viewer import colours
from services.viewer.shapes import hole_mesh, peg_length, peg_mesh
from services.wire.definition import Definition
from services.wire.messages import Force

WIDE, SCENE_HIGH, CURVE_HIGH = 480, 400, 140
"""Size of a picture [pixels]: the scene, and below it the curve."""
FINER = 2
"""The scene is drawn so many times as large, and then made smaller: soft edges."""
EYE = (31.0, -47.0, -36.0)
"""Direction that the scene is looked at from, hole frame."""
ARROW_MM_PER_N = 3.0
LONGEST_ARROW_MM = 30.0
AXIS_MM = 6.0
BACKGROUND: Colour = (24, 26, 30)
INK: Colour = (225, 225, 225)
FAINT: Colour = (110, 112, 118)
AXES: tuple[tuple[str, Colour], ...] = (("x", colours.SKY_BLUE), ("y", colours.ORANGE), ("z", colours.GREEN))


class Shot(NamedTuple):
    """What one picture shows."""

    peg: Pose
    """Actual pose of the tip in the hole frame."""
    force_n: Force
    """Force on the peg in the tool frame [N]."""
    forces_n: Sequence[float]
    """Magnitude of the force after each motion so far [N]."""
    caption: str
    decided: bool = True
    """Whether the motion was a decision, or guidance."""


class Scene:
    """Pictures of one definition's parts; the hole is drawn once."""

    def __init__(self, definition: Definition, motions: int = 0) -> None:
        """``motions``: length of the curve's axis, 0 for one that grows with the episode."""
        parts, limits = definition.parts, definition.limits
        self._motions = motions
        self._contact_n, self._collision_n = limits.contact_force_n, limits.collision_force_n
        self._peg, self._back_mm = peg_mesh(parts), peg_length(parts)
        size = parts.peg_width_mm + 2.0 * (parts.clearance_mm + parts.chamfer_mm) + 14.0
        eye = size * np.array(EYE) / 30.0
        self._camera = Camera(
            (float(eye[0]), float(eye[1]), float(eye[2])),
            (0.0, 0.0, -0.04 * size),
            (0.0, 0.0, -1.0),
            1.4 * size,
            FINER * WIDE,
            FINER * SCENE_HIGH,
        )
        self._empty = Canvas(self._camera, BACKGROUND)
        hole = hole_mesh(parts)
        self._empty.draw(hole.corners, hole.normals, (172, 172, 176))
        self._font, self._small = ImageFont.load_default(15), ImageFont.load_default(12)

    def picture(self, shot: Shot) -> Pixels:
        """Return a picture, red, green, blue from 0 to 255, shape (SCENE_HIGH + CURVE_HIGH, WIDE, 3)."""
        image = Image.new("RGB", (WIDE, SCENE_HIGH + CURVE_HIGH), BACKGROUND)
        image.paste(self._scene(shot), (0, 0))
        draw = ImageDraw.Draw(image)
        draw.text((10, 8), shot.caption, fill=INK, font=self._font)
        self._curve(draw, shot.forces_n)
        return np.asarray(image, dtype=np.uint8).copy()

    def _scene(self, shot: Shot) -> Image.Image:
        canvas = self._empty.copy()
        corners, normals = (_turned(shot.peg, points) for points in (self._peg.corners, self._peg.normals))
        canvas.draw(corners + shot.peg.position, normals, colours.SKY_BLUE, 0.75)
        image = Image.fromarray(canvas.pixels)
        draw = ImageDraw.Draw(image)
        origin = shot.peg.position
        for axis, (name, colour) in enumerate(AXES):
            arm = tuple(AXIS_MM if axis == other else 0.0 for other in range(3))
            self._arrow(draw, origin, _sum(origin, rotate(shot.peg.orientation, arm)), colour, 2, name)
        size = math.hypot(*shot.force_n)
        if size >= self._contact_n:
            along = min(ARROW_MM_PER_N * size, LONGEST_ARROW_MM) / size
            end = rotate(shot.peg.orientation, tuple(along * value for value in shot.force_n))
            self._arrow(draw, origin, _sum(origin, end), colours.VERMILION, 5, f"{size:.1f} N")
        return image.resize((WIDE, SCENE_HIGH), Image.Resampling.BOX)

    def _arrow(
        self,
        draw: ImageDraw.ImageDraw,
        start: tuple[float, float, float],
        end: tuple[float, float, float],
        colour: Colour,
        width: int,
        name: str,
    ) -> None:
        (ax, ay, _), (bx, by, _) = self._camera.project([start, end]).tolist()
        draw.line((ax, ay, bx, by), fill=colour, width=width * FINER // 2 + 1)
        length = math.hypot(bx - ax, by - ay) or 1.0
        ux, uy, head = (bx - ax) / length, (by - ay) / length, 3.0 * width
        back_x, back_y = bx - head * ux, by - head * uy
        sides = [(back_x - head / 2 * uy, back_y + head / 2 * ux), (back_x + head / 2 * uy, back_y - head / 2 * ux)]
        draw.polygon([(bx, by), *sides], fill=colour)
        font = ImageFont.load_default(13 * FINER)
        draw.text((bx + 10 * ux, by + 10 * uy), name, fill=colour, font=font, anchor="mm" if width < 5 else "lm")

    def _curve(self, draw: ImageDraw.ImageDraw, forces_n: Sequence[float]) -> None:
        """Draw the magnitude of the force over the motions, with the two limits that matter."""
        left, right = 44, WIDE - 12
        top, bottom = SCENE_HIGH + 22, SCENE_HIGH + CURVE_HIGH - 20
        most = 1.1 * max(self._collision_n, *forces_n, 1.0)
        length = max(self._motions, len(forces_n), 20)

        def at(motion: int, force_n: float) -> tuple[float, float]:
            return left + (right - left) * motion / length, bottom - (bottom - top) * force_n / most

        draw.text((left, SCENE_HIGH + 3), "force on the peg [N] by motion", fill=INK, font=self._small)
        draw.line((left, top, left, bottom, right, bottom), fill=FAINT)
        for force_n, colour, name in (
            (self._collision_n, colours.VERMILION, f"{self._collision_n:g}"),
            (self._contact_n, colours.GREEN, f"{self._contact_n:g}"),
        ):
            height = at(0, force_n)[1]
            draw.line((left, height, right, height), fill=colour)
            draw.text((left - 5, height), name, fill=colour, font=self._small, anchor="rm")
        draw.text((right, bottom + 3), str(length), fill=FAINT, font=self._small, anchor="ra")
        points = [at(motion, force_n) for motion, force_n in enumerate(forces_n, start=1)]
        if len(points) > 1:
            draw.line(points, fill=colours.YELLOW, width=2)
        if points:
            x, y = points[-1]
            draw.ellipse((x - 3, y - 3, x + 3, y + 3), fill=colours.YELLOW)


def _turned(pose: Pose, points: np.ndarray[tuple[int, ...], np.dtype[np.float32]]) -> Floats:
    """Return tool-frame directions, shape (n, 3), in the hole frame."""
    axes = [rotate(pose.orientation, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
    turned: Floats = points.astype(np.float64) @ np.array(axes)
    return turned


def _sum(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float, float]:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])
