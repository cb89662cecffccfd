"""The messages of a robot: motions, and what stops and resumes them."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from services.wire.message_base import LONGEST_EPISODE, Degree, Episode, Message, Millimetre, Nanoseconds, RunId, Step


class Home(Message, frozen=True, kw_only=True):
    """Request on ``home``: put the peg at the start pose of an episode; pose of the tip in the hole frame."""

    run: RunId
    episode: Episode
    x_mm: Millimetre
    y_mm: Millimetre
    z_mm: Millimetre
    rx_deg: Degree
    ry_deg: Degree
    rz_deg: Degree


class Move(Message, frozen=True, kw_only=True):
    """Request on ``move``: one increment. ``step`` counts from 1; a robot takes only the next, or the last again."""

    run: RunId
    episode: Episode
    step: Annotated[int, Meta(ge=1, le=LONGEST_EPISODE)]
    dx_mm: Millimetre = 0.0
    dy_mm: Millimetre = 0.0
    dz_mm: Millimetre = 0.0
    rx_deg: Degree = 0.0
    ry_deg: Degree = 0.0
    rz_deg: Degree = 0.0


class Moved(Message, frozen=True, kw_only=True):
    """Reply to ``home`` and ``move``: what was really applied, and from when on F/T samples show it."""

    run: RunId
    episode: Episode
    step: Step
    arrived_t_ns: Nanoseconds
    """F/T samples with ``t_ns`` at or after this time were taken after the motion had settled."""
    dx_mm: Millimetre = 0.0
    dy_mm: Millimetre = 0.0
    dz_mm: Millimetre = 0.0
    rx_deg: Degree = 0.0
    ry_deg: Degree = 0.0
    rz_deg: Degree = 0.0


class Resume(Message, frozen=True, kw_only=True):
    """Request on ``resume``: let the arm move again after a stop. Asked without one, it is only said what holds it."""

    stop_t_ns: Nanoseconds
    """Name of the stop that is meant; refused when another one has come since."""


class Stop(Message, frozen=True, kw_only=True):
    """Reply to ``resume``: what holds the arm until somebody lets it move."""

    stop_t_ns: Nanoseconds
    """When it was stopped, and the name of that stop; 0 when nothing holds it."""
    why: Annotated[str, Meta(max_length=200)]
