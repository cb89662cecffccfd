"""What of a simulated world is not as its task believes: a hole that is tilted, parts that change during a run."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from services.wire.definition_base import AngleDeg, Checked, NotNegative
from services.wire.message_base import LONGEST_RUN


class Hole(Checked, frozen=True, kw_only=True):
    """How the hole stands in the frame that starts are given in, turned about the centre of its mouth: R = Ry Rx.

    Task and guard do not know it: for them the direction of insertion is that of an upright hole.
    """

    rx_deg: AngleDeg = 0.0
    """Tilt of the hole's axis about X."""
    ry_deg: AngleDeg = 0.0
    """Tilt about Y."""
    tilt_spread_deg: Annotated[float, Meta(ge=0, le=10)] = 0.0
    """Half width of a uniform random offset added to both angles in each episode."""

    @property
    def most_deg(self) -> tuple[float, float]:
        """Greatest tilt about X and about Y that an episode can have [deg]."""
        return abs(self.rx_deg) + self.tilt_spread_deg, abs(self.ry_deg) + self.tilt_spread_deg


class Change(Checked, frozen=True, kw_only=True):
    """One setting of the parts that is another one from the beginning of an episode on."""

    episode: Annotated[int, Meta(ge=1, le=LONGEST_RUN)]
    """The first episode with the new value; the run's first is 0."""
    key: Literal["contact.friction", "contact.stiffness_n_per_mm", "parts.clearance_mm", "parts.chamfer_mm"]
    """What changes."""
    value: NotNegative
    """The new value, in the range that the key has."""
