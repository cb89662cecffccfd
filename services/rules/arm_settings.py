"""Settings that every arm has, each with its one range; what is usual is the arm's own."""

from __future__ import annotations

from services.rules.settings import setting


def start_height_mm() -> float:
    """Of the tip above the hole's mouth at the start pose [mm]."""
    return setting(20.0, "of the tip above the mouth at the start pose", within=(0.0, 500.0))


def withdraw_mm() -> float:
    """How far the peg is pulled back along its axis, before anything else in ``home``; 0 for not at all [mm]."""
    return setting(40.0, "pull back along the peg's axis before homing", within=(0.0, 500.0))


def within_mm(usual: float) -> float:
    """How far off counts as arrived [mm]."""
    return setting(usual, "counts as arrived", within=(0.001, 5.0))


def within_deg(usual: float) -> float:
    """How far off counts as arrived [deg]."""
    return setting(usual, "counts as arrived", within=(0.001, 5.0))


def move_s(usual: float) -> float:
    """How long a motion may take [s]."""
    return setting(usual, "longest time of a motion", within=(0.1, 600.0))


def settle_s(usual: float) -> float:
    """From arrival to the first F/T sample that counts: for arm and filter to calm down [s]."""
    return setting(usual, "from arrival to the first sample that counts", within=(0.0, 10.0))


def oldest_s() -> float:
    """Age of an F/T sample above which it says nothing about now [s]."""
    return setting(0.1, "age above which an F/T sample says nothing about now", within=(0.01, 10.0))
