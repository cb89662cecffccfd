"""Whether a first touch has failed to come: the arm is where the peg must press, and nothing is felt. Pure.

A sensor that says 0 N all the way lets guidance push a peg through the rim. What the arm was told since ``home`` says
where the tip would be if nothing gave way. Where that is deeper inside the material than the errors of arm and taught
location explain, by more than it takes the wrist to feel a contact twice over, the sensor does not feel. An episode
that was in contact once, in which the arm was told anything but +Z, or that begins so well that the peg may go in
freely, is none of this rule's business.
"""

from __future__ import annotations

import math

from services.rules.workspace import UPRIGHT, Matrix, Vector, rotation, turned
from services.wire.actions import Increment
from services.wire.cross_section import CrossSection
from services.wire.definition import Definition
from services.wire.definition_changes import phases
from services.wire.felt_noise import contact_force_n
from services.wire.messages import FtPacket, Home

ASIDE_MM = 0.5
"""How far the taught location may be from where it should be."""
_SURE = 5.0
_POINTS = 24


class Touch:
    """Where the tip was commanded to, and whether it was ever felt to touch."""

    def __init__(self, definition: Definition) -> None:
        parts, wrist, noise = definition.parts, definition.wrist, definition.noise
        times = [settings for _, settings in phases(definition)]
        self._section = CrossSection(parts)
        # What is in force when is not asked: the widest hole and the softest peg of the run.
        self._clearance_mm = max(settings.parts.clearance_mm for settings in times)
        self._chamfer_mm = max(settings.parts.chamfer_mm for settings in times)
        self._lean = math.tan(math.radians(sum(definition.hole.most_deg)))
        self._edge = _edge(self._section)
        self._contact_n = contact_force_n(definition)
        # The tip gives way by the wrist's shift, by its turn about the sensor's point, and by the peg's own surface.
        soft = 1.0 / wrist.stiffness_n_per_mm + wrist.sensor_height_mm**2 / (1000.0 * wrist.stiffness_nm_per_rad)
        surfaces = [settings.contact.stiffness_n_per_mm for settings in times]
        soft += max(1.0 / stiffness if stiffness else 0.0 for stiffness in surfaces)
        self._felt_mm = 2.0 * self._contact_n * soft
        self._error_mm = _SURE * noise.scale * max(noise.along_mm, noise.across_mm)
        self._turn_error = _SURE * noise.scale * math.radians(noise.turn_deg) * parts.peg_height_mm
        self._position: Vector = (0.0, 0.0, 0.0)
        self._turn: Matrix = UPRIGHT
        self._moves = 0
        self._touched = True
        """Nothing is expected before ``home``."""

    def begin(self, home: Home) -> None:
        """Begin at a start pose; the tip is in free space there."""
        self._position = (home.x_mm, home.y_mm, home.z_mm)
        self._turn = rotation(home.rx_deg, home.ry_deg, home.rz_deg)
        self._moves, self._touched = 0, False

    def take(self, increment: Increment) -> None:
        """Add a motion that was made."""
        if increment[:2] != (0.0, 0.0) or increment[3:] != (0.0, 0.0, 0.0):
            self._touched = True  # it is not guidance that asks for it, and how far the material goes is not known
        if not self._touched:
            self._moves += 1
            self._position = self._after(increment)

    def feel(self, packet: FtPacket) -> None:
        """Take note of what is felt."""
        if not self._touched:
            self._touched = max(math.hypot(*force) for force in packet.force_n) >= self._contact_n

    def missing(self) -> str | None:
        """Return why nothing may move on: where the arm is, a touch must have come; None otherwise."""
        if self._touched:
            return None
        errors_mm = (self._error_mm + self._turn_error) * math.sqrt(self._moves)
        inside_mm = self._inside_mm()
        # A hole that is tilted about its mouth is elsewhere by the more, the farther from there the edge is.
        elsewhere_mm = self._lean * (math.hypot(*self._position) + self._section.radius_mm)
        if inside_mm <= self._felt_mm + ASIDE_MM + errors_mm + elsewhere_mm:
            return None
        expected = f"expected a touch of {self._contact_n:g} N at the latest {inside_mm:.2f} mm inside the material"
        return f"guard: sensor: {expected}, got none since home; does it feel? only home is taken"

    def _after(self, increment: Increment) -> Vector:
        dx, dy, dz = turned(self._turn, increment[:3])
        x, y, z = self._position
        return x + dx, y + dy, z + dz

    def _inside_mm(self) -> float:
        """Return the least way [mm] out of the material for the edge of the tip; 0 when all of it is free."""
        x, y, z = self._position
        deepest_mm = 0.0
        for point in self._edge:
            dx, dy, dz = turned(self._turn, point)
            px, py, pz = x + dx, y + dy, z + dz
            beyond = self._section.aside(px, py) - self._section.half_width_mm
            over = beyond - self._clearance_mm - max(0.0, self._chamfer_mm - pz)
            deepest_mm = max(deepest_mm, min(pz, over / math.sqrt(2.0)))
        return deepest_mm


def _edge(section: CrossSection) -> tuple[Vector, ...]:
    """Return points on the edge of the tip, in the tool frame [mm]."""
    if not section.is_round:
        return tuple((x, y, 0.0) for x, y in section.corners)
    angles = (2.0 * math.pi * n / _POINTS for n in range(_POINTS))
    return tuple((section.radius_mm * math.cos(angle), section.radius_mm * math.sin(angle), 0.0) for angle in angles)
