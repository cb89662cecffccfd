"""The messages of a force/torque sensor: samples, and what is taken from them."""

from __future__ import annotations

from typing import Annotated, ClassVar

from msgspec import Meta, Struct

from services.wire.message_base import MOST_SAMPLES, Count, Force, Message, Nanoseconds, Step, Torque


class FtPacket(Message, frozen=True, kw_only=True):
    """Consecutive F/T samples, oldest first; those of one motion from the simulator, whatever comes from a sensor."""

    VERSION: ClassVar[int] = 2

    sequence: Count
    """Number of the newest sample; a jump larger than the packet means that samples were lost."""
    t_ns: Nanoseconds
    """When the newest sample was taken."""
    period_ns: Annotated[int, Meta(ge=0, le=10**10)] = 0
    """Time between samples; 0 for a single one, and for those of the simulator, whose time stands still."""
    status: Annotated[int, Meta(ge=0, le=0xFFFF)] = 0
    """0 is good. Bit 0 saturated, 1 near saturation, 2 sensor lost, 3 sensor changed, 4 not yet zeroed."""
    force_n: Annotated[tuple[Force, ...], Meta(min_length=1, max_length=MOST_SAMPLES)]
    torque_nm: Annotated[tuple[Torque, ...], Meta(min_length=1, max_length=MOST_SAMPLES)]


class Zero(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a sensor showed in the air: it is taken from all that is felt from a step on."""

    step: Step
    """Motions made before it is in force: 0, or more where the sensor began anew within the episode."""
    force_n: Force
    torque_nm: Torque
    sigma_n: Annotated[float, Meta(ge=0, le=1e6)]
    """Standard deviation of its samples, of a force component."""
