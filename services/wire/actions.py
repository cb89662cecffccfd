"""The action sets: one increment each in the tool frame, in a fixed order (thesis 6.1, 6.4). -Z is never allowed."""

from __future__ import annotations

from typing import NamedTuple

from services.wire.definition import Moves

ACTION_NAMES = ("+X", "-X", "+Y", "-Y", "+Z", "+RX", "-RX", "+RY", "-RY", "+RZ", "-RZ")
INSERT = ACTION_NAMES.index("+Z")
"""Index of the action that steps in the direction of insertion."""


class Increment(NamedTuple):
    """One motion in the tool frame: translation along its axes [mm], rotation about them through the tip [deg].

    Several rotations in one increment combine as R = Rz(rz) Ry(ry) Rx(rx).
    """

    dx_mm: float = 0.0
    dy_mm: float = 0.0
    dz_mm: float = 0.0
    rx_deg: float = 0.0
    ry_deg: float = 0.0
    rz_deg: float = 0.0


def action_names(moves: Moves) -> tuple[str, ...]:
    """Return the names of an experiment's 5, 9 or 11 actions."""
    return ACTION_NAMES[: moves.actions]


def increments(moves: Moves) -> tuple[Increment, ...]:
    """Return the increment of each of an experiment's actions."""
    lateral, turn = moves.lateral_mm, moves.rotation_deg
    return (
        Increment(dx_mm=lateral),
        Increment(dx_mm=-lateral),
        Increment(dy_mm=lateral),
        Increment(dy_mm=-lateral),
        Increment(dz_mm=moves.insertion_mm),
        Increment(rx_deg=turn),
        Increment(rx_deg=-turn),
        Increment(ry_deg=turn),
        Increment(ry_deg=-turn),
        Increment(rz_deg=turn),
        Increment(rz_deg=-turn),
    )[: moves.actions]
