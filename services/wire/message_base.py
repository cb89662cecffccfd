"""What all messages are made of: their base, and numbers and names with their ranges."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from msgspec import Meta, Struct

LONGEST_RUN = 1_000_000
"""Episodes. The simulator's clock has room for 1.7 million of the longest, keys for a hundred million."""
LONGEST_EPISODE = 100_000
"""Motions."""
MOST_SAMPLES = 512
"""Of the sensor, in one message and in one window."""
MOST_STATES = 1_000_000
MOST_ACTIONS = 64
"""Moves that an agent may choose from."""
MOST_SWAPS = 64
"""Of one run."""
Count = Annotated[int, Meta(ge=0, le=2**53)]
"""Whatever is counted: every language and every file format has room for it."""
Nanoseconds = Annotated[int, Meta(ge=0, le=2**62)]
Episode = Annotated[int, Meta(ge=0, le=LONGEST_RUN - 1)]
"""Number of an episode, from 0."""
Episodes = Annotated[int, Meta(ge=0, le=LONGEST_RUN)]
"""How many there are."""
Step = Annotated[int, Meta(ge=0, le=LONGEST_EPISODE)]
"""Motions made in an episode."""
Decision = Annotated[int, Meta(ge=0, le=LONGEST_RUN * LONGEST_EPISODE)]
"""Decisions taken in a run."""
StateNumber = Annotated[int, Meta(ge=0, le=MOST_STATES - 1)]
"""Number of a contact state, from 0."""
States = Annotated[int, Meta(ge=0, le=MOST_STATES)]
"""How many there are."""
SwapCount = Annotated[int, Meta(ge=0, le=MOST_SWAPS)]
Seed = Annotated[int, Meta(ge=0, le=2**63 - 1)]
RunId = Annotated[str, Meta(pattern=r"^[0-9a-z][0-9a-z-]{0,79}\Z")]
Sha256 = Annotated[str, Meta(pattern=r"^[0-9a-f]{64}\Z")]
ServiceName = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]{0,31}\Z")]
RequestId = Annotated[str, Meta(pattern=r"^[0-9a-f]{32}\Z")]
LARGEST_COMPONENT = 1e5
"""Bound of a force [N] or torque [N m] in a message and in a query."""
Newton = Annotated[float, Meta(ge=-LARGEST_COMPONENT, le=LARGEST_COMPONENT)]
NewtonMetre = Annotated[float, Meta(ge=-LARGEST_COMPONENT, le=LARGEST_COMPONENT)]
Force = tuple[Newton, Newton, Newton]
Torque = tuple[NewtonMetre, NewtonMetre, NewtonMetre]
Number = Annotated[float, Meta(ge=-1e12, le=1e12)]
Millimetre = Annotated[float, Meta(ge=-1e4, le=1e4)]
Degree = Annotated[float, Meta(ge=-360, le=360)]
Motion = tuple[Millimetre, Millimetre, Millimetre, Degree, Degree, Degree]
"""An increment: dx_mm, dy_mm, dz_mm, rx_deg, ry_deg, rz_deg."""
Reason = Literal["bad_request", "foreign_run", "out_of_order", "guard", "not_ready", "stopped"]
Outcome = Literal["inserted", "collision", "no_progress", "move_limit"]


class Message(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of all messages; ``VERSION`` goes up when a type changes."""

    VERSION: ClassVar[int] = 1
    LARGEST_BYTES: ClassVar[int] = 1 << 16
    """A larger payload is refused unread: it cannot be honest, and reading it would cost its reader time and memory."""
