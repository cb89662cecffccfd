"""The most that one motion can add to the force felt, by the model of wrist, arm and sensor.

The wrist is a spring: k for shifts of its centre, c for turns, and it gives way where the sensor sits, ``lever`` away
from the point that rotations turn about, so that one by an angle a shifts it by lever times a. Whatever the
surroundings do to a peg that settles, they take energy out of the spring; only the arm puts some in. Measured as
sqrt(2 energy), the load therefore grows by no more than the arm's own motion, sqrt(k shift^2 + c turn^2), and the force
by sqrt(k) times that.

Not covered is the load that was there as a turn and becomes force when a jammed peg slips or swings. ``SETTLING_N`` is
an allowance for that; docs/decisions/0011 has what was measured.
"""

from __future__ import annotations

import math

from services.wire.actions import Increment, guidance, increments
from services.wire.definition import Definition
from services.wire.felt_noise import window_sigma_n
from services.wire.low_pass import unfelt

SETTLING_N = 0.5
"""Allowance for what a pressed peg's force does when it settles anew, without a motion to cause it [N]."""
SURE = 5.0
"""How many standard deviations of the errors of arm and sensor are allowed for: one motion in 3 million has more."""


class ForceBound:
    """The bound for one definition; pure."""

    def __init__(self, definition: Definition) -> None:
        wrist, noise = definition.wrist, definition.noise
        self._per_mm = wrist.stiffness_n_per_mm
        self._per_rad = math.sqrt(1000.0 * wrist.stiffness_n_per_mm * wrist.stiffness_nm_per_rad)
        self._lever_mm = abs(wrist.sensor_height_mm - definition.moves.rotation_centre_mm)
        shift_mm = max(noise.along_mm, noise.across_mm)
        turn = math.radians(noise.turn_deg)
        arm_n = math.hypot(self._per_mm * (shift_mm + self._lever_mm * turn), self._per_rad * turn)
        # Twice the sensor's: the reading before may be too low, the one after too high.
        # The zero's own error is in both, so that it adds nothing.
        sensor_n = window_sigma_n(definition)
        self._unsure_n = SURE * math.sqrt((noise.scale * arm_n) ** 2 + 2.0 * sensor_n**2) + SETTLING_N
        motions = (*increments(definition.moves), guidance(definition.moves))
        late = unfelt(definition.sensor)
        if late > 0.0:  # a filter shows less than there was before the motion
            self._unsure_n += late * max(map(self._spring_n, motions))
        self.largest_n = max(map(self.added_n, motions))
        """The most that one of the experiment's actions adds [N]."""
        self.needed_n = definition.limits.collision_force_n + self.largest_n
        """The least hard limit [N] that lets every action pass as long as no collision has ended the episode."""

    def added_n(self, increment: Increment) -> float:
        """Return the most that a motion adds to the magnitude of the force [N], errors of arm and sensor included."""
        return self._spring_n(increment) + self._unsure_n

    def _spring_n(self, increment: Increment) -> float:
        """Return what it adds by itself [N]."""
        tilt, turn = math.radians(math.hypot(*increment[3:5])), math.radians(math.hypot(*increment[3:]))
        shift_mm = math.hypot(*increment[:3]) + self._lever_mm * tilt
        return math.hypot(self._per_mm * shift_mm, self._per_rad * turn)
