"""What of a definition says which moves an agent may make: listed ones, and bounds for any others."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from services.wire.definition_base import Bound, Checked, SignedStep, StepSize
from services.wire.message_base import MOST_ACTIONS


class NamedMove(Checked, frozen=True, kw_only=True):
    """One action: an increment in the tool frame; what turns, turns about ``rotation_centre_mm``."""

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9+-][A-Za-z0-9+_-]{0,15}\Z")]
    """What it is called in tables, plots and answers."""
    x_mm: SignedStep = 0.0
    """Shift along X."""
    y_mm: SignedStep = 0.0
    """Shift along Y."""
    z_mm: SignedStep = 0.0
    """Shift along Z: insertion, or below 0 back out."""
    rx_deg: SignedStep = 0.0
    """Turn about X; several combine as R = Rz Ry Rx."""
    ry_deg: SignedStep = 0.0
    """Turn about Y."""
    rz_deg: SignedStep = 0.0
    """Turn about the peg."""


class Continuous(Checked, frozen=True, kw_only=True):
    """Bounds of a move that is no listed one, for a learner that proposes increments (docs/extending.md).

    All of them 0: there are none, and an agent answers the number of a move. A move within the bounds adds, besides, no
    more force than the most forceful of the list, or the guard would refuse it; it counts as that move of the list that
    goes the same way along Z.
    """

    x_mm: Bound = 0.0
    """Most along X, either way."""
    y_mm: Bound = 0.0
    """Most along Y, either way."""
    z_mm: Bound = 0.0
    """Most along +Z; from half of it on, a move counts as one of insertion."""
    back_mm: Bound = 0.0
    """Most along -Z, back out."""
    rx_deg: Bound = 0.0
    """Most about X, either way; several turns combine as R = Rz Ry Rx."""
    ry_deg: Bound = 0.0
    """Most about Y, either way."""
    rz_deg: Bound = 0.0
    """Most about the peg, either way."""

    @property
    def any(self) -> bool:
        """Whether there are bounds."""
        return self != Continuous()


class Moves(Checked, frozen=True, kw_only=True):
    """The agent's actions: one increment each, in the tool frame (thesis 6.1, 6.4)."""

    actions: Literal[5, 9, 11] = 9
    """5: +-X +-Y +Z. 9: and +-rotation about X and Y. 11: and +-rotation about Z."""
    lateral_mm: StepSize = 0.2
    """Size of a move along X or Y."""
    insertion_mm: StepSize = 0.2
    """Size of a move along +Z, the agent's and the guidance's alike."""
    rotation_deg: StepSize = 0.2
    """Size of a rotation."""
    rotation_centre_mm: Annotated[float, Meta(ge=0, le=500)] = 0.0
    """How far behind the tip the point is that rotations turn about: 0 for the tip, else the lever of a flange."""
    list: Annotated[tuple[NamedMove, ...], Meta(max_length=MOST_ACTIONS)] = ()
    """The actions one by one, in place of the numbered ones and their sizes; guidance steps by insertion_mm still."""

    continuous: Continuous = Continuous()

    @property
    def count(self) -> int:
        """How many actions there are."""
        return len(self.list) or self.actions
