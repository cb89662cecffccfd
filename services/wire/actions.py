"""The action sets: increments in the tool frame, the thesis's in its order (6.1, 6.4) or as a definition lists them.

Of the thesis's, -Z is never allowed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from services.wire.definition import Moves

ACTION_NAMES = ("+X", "-X", "+Y", "-Y", "+Z", "+RX", "-RX", "+RY", "-RY", "+RZ", "-RZ")
INSERT = ACTION_NAMES.index("+Z")
"""Index of the action, of the thesis's, that steps in the direction of insertion."""


GRID = 4
"""Decimals [mm, deg] of a move that is no listed one: those that every robot makes and answers with."""
_SAME = 1e-9
"""Distance between unit vectors up to which two directions are one."""


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
    """Return the names of an experiment's actions."""
    return tuple(move.name for move in moves.list) or ACTION_NAMES[: moves.actions]


def increments(moves: Moves) -> tuple[Increment, ...]:
    """Return the increment of each of an experiment's actions."""
    if moves.list:
        return tuple(Increment(m.x_mm, m.y_mm, m.z_mm, m.rx_deg, m.ry_deg, m.rz_deg) for m in moves.list)
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


def guidance(moves: Moves) -> Increment:
    """Return the step that the task makes by itself where nothing is touched."""
    return Increment(dz_mm=moves.insertion_mm)


def extremes(moves: Moves) -> tuple[Increment, ...]:
    """Return the moves that there are, the task's own step, and of any others the least and the greatest of each axis.

    The last two only where there are bounds: then every move is, axis by axis, between some of these.
    """
    most, motions = moves.continuous, (*increments(moves), guidance(moves))
    if not most.any:
        return motions
    turns = (most.rx_deg, most.ry_deg, most.rz_deg)
    low = Increment(-most.x_mm, -most.y_mm, -most.back_mm, *(-turn for turn in turns))
    return (*motions, low, Increment(most.x_mm, most.y_mm, most.z_mm, *turns))


def repeatable(moves: Moves) -> tuple[bool, ...]:
    """Return whether each action stays at its depth, so that exploration may go on with it."""
    return tuple(increment.dz_mm == 0.0 for increment in increments(moves))


def lines(moves: Moves) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Return the line of motion of each action, numbered from 0, and its signed size on it.

    Moves in the same direction, or in opposite ones, are on one line; its largest has size 1 or -1.
    """
    directions: list[tuple[float, ...]] = []
    line_of, length_of = [], []
    for increment in increments(moves):
        length = math.hypot(*increment)
        sign = next(math.copysign(1.0, value) for value in increment if value)
        direction = tuple(sign * value / length for value in increment)
        line = next((n for n, other in enumerate(directions) if math.dist(direction, other) < _SAME), len(directions))
        directions += [direction] if line == len(directions) else []
        line_of.append(line)
        length_of.append(sign * length)
    largest = [0.0] * len(directions)
    for line, length in zip(line_of, length_of, strict=True):
        largest[line] = max(largest[line], abs(length))
    return tuple(line_of), tuple(length / largest[line] for length, line in zip(length_of, line_of, strict=True))


def lateral_moves(moves: Moves) -> dict[tuple[int, int], int]:
    """Return the shortest move in each lateral direction that has one, as its action by signs along X and Y."""
    shortest: dict[tuple[int, int], int] = {}
    steps = increments(moves)
    for action, step in enumerate(steps):
        others = step._replace(dx_mm=0.0, dy_mm=0.0)
        if any(others) or bool(step.dx_mm) == bool(step.dy_mm):
            continue
        direction = ((step.dx_mm > 0) - (step.dx_mm < 0), (step.dy_mm > 0) - (step.dy_mm < 0))
        length = abs(step.dx_mm + step.dy_mm)
        if direction not in shortest or length < abs(sum(steps[shortest[direction]][:2])):
            shortest[direction] = action
    return shortest
