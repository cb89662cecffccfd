"""A contact world that remembers what it has already simulated.

Physics is deterministic: from the same start pose the same motions give the same readings, bit for bit. A learnt policy
makes the same motions in nearly every episode, so most of a long run is repetition; this world answers that from memory
and lets physics catch up only when an episode leaves what is known. Results do not change, only the time they take.
An arm with an error never makes the same motion twice: then there is nothing to remember, and nothing is.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from services.sim.pose import Pose
from services.sim.world import Reading, World
from services.wire.actions import Increment
from services.wire.definition import Definition

MOST_REMEMBERED = 300_000
"""Motions remembered, some 100 MB; then all is forgotten."""


@dataclass(slots=True)
class _Place:
    """A reading, and what followed it."""

    reading: Reading
    following: dict[Increment, _Place] = field(default_factory=dict)


class RememberedWorld(World):
    """Drop-in for ``World``; the first time round it is the same physics."""

    def __init__(self, definition: Definition) -> None:
        """Build the world of a definition, remembering nothing yet."""
        super().__init__(definition)
        noise = definition.noise
        self._repeats = noise.scale * max(noise.along_mm, noise.across_mm, noise.turn_deg) == 0.0
        self._homes: dict[Pose, _Place] = {}
        self._remembered = 0
        self._made: list[Increment] = []
        self._behind = False
        """Whether physics still has to make the episode's motions."""

    def home(self, pose: Pose) -> Reading:
        """Begin an episode; see ``World.home``."""
        if not self._repeats:
            return super().home(pose)
        if self._remembered > MOST_REMEMBERED:
            self._homes.clear()
            self._remembered = 0
        self._start = pose
        self._made.clear()
        self._behind = pose in self._homes
        if not self._behind:
            self._homes[pose] = _Place(super().home(pose))
        self._here = self._homes[pose]
        return self._here.reading

    def move(self, increment: Increment) -> Reading:
        """Make one motion; see ``World.move``."""
        if not self._repeats:
            return super().move(increment)
        place = self._here.following.get(increment) if self._behind else None
        if place is None:
            self._catch_up()
            place = self._here.following.setdefault(increment, _Place(super().move(increment)))
            self._remembered += 1
        self._made.append(increment)
        self._here = place
        return place.reading

    def contact_state(self) -> str:
        """Return the true contact state; see ``World.contact_state``."""
        self._catch_up()
        return super().contact_state()

    @property
    def flange(self) -> Pose:
        """Commanded pose of the tip; see ``World.flange``."""
        self._catch_up()
        return super().flange

    @property
    def peg(self) -> Pose:
        """Actual pose of the tip; see ``World.peg``."""
        self._catch_up()
        return super().peg

    def _catch_up(self) -> None:
        """Let physics make the motions that were answered from memory."""
        if self._behind:
            self._behind = False
            super().home(self._start)
            for increment in self._made:
                super().move(increment)
