"""The messages about an arm that is stopped; see ``services.rules.hold``."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from services.wire.message_base import Count, Message


class Resume(Message, frozen=True, kw_only=True):
    """Request on ``resume``: let the arm move again after a stop. Asked without one, it is only said what holds it."""

    stop_t_ns: Count
    """Name of the stop that is meant; refused when another one has come since."""


class Stop(Message, frozen=True, kw_only=True):
    """Reply to ``resume``: what holds the arm until somebody lets it move."""

    stop_t_ns: Count
    """When it was stopped, and the name of that stop; 0 when nothing holds it."""
    why: Annotated[str, Meta(max_length=200)]
