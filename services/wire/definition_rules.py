"""What no single key of a definition can show: settings that contradict each other. Pure."""

from __future__ import annotations

import math

from msgspec import ValidationError, convert, to_builtins

from services.wire.actions import extremes, increments, lateral_moves
from services.wire.cross_section import Corner, CrossSection
from services.wire.definition import (
    SPREADS,
    Art2Settings,
    Definition,
    FeltModel,
    LearnerSettings,
    Moves,
    Plugin,
    Start,
    TdSettings,
    Thompson,
    Unclassified,
)
from services.wire.definition_changes import phases
from services.wire.force_bound import ForceBound
from services.wire.force_rules import force_rules
from services.wire.text import in_words

_ROUNDING = 1e-9
_TURNS = 4
"""Angles on each side that a peg's turn is looked at; a corner reaches farthest at the greatest but in flat shapes."""
LEAST_BREADTH_MM = 2.0
"""Least side of a peg, as for ``peg_width_mm``."""
_SOFTEST_N_PER_MM = 1.0
"""A peg softer than this sinks into the material instead of touching it."""


def contradiction(definition: Definition) -> tuple[str, str] | None:
    """Return a key whose value cannot be used beside the others, with what was expected and got; None for none.

    It is what no single field can show: a definition without one can be simulated and learnt.
    """
    parts, limits, classifier, sensor = definition.parts, definition.limits, definition.classifier, definition.sensor
    theta, encoding = (classifier.theta, classifier.encoding) if isinstance(classifier, Art2Settings) else (0.0, "odd")
    inputs = 6 if encoding == "odd" else 12
    height_mm, dip_mm = definition.start.height_mm, _dip_mm(definition)
    room_mm = parts.clearance_mm + parts.chamfer_mm - max(0.0, dip_mm - height_mm)
    stiffness, wrist = definition.contact.stiffness_n_per_mm, definition.wrist
    mount = (wrist.sensor_rx_deg, wrist.sensor_ry_deg, wrist.sensor_rz_deg)
    felt, shaping, gamma = definition.felt, definition.shaping, discount_of(definition.learner)
    rules = (
        (
            limits.contact_force_n < limits.collision_force_n,
            "limits.contact_force_n",
            f"expected less than limits.collision_force_n = {limits.collision_force_n}, got {limits.contact_force_n}",
        ),
        *force_rules(definition),
        (
            limits.collision_force_n < limits.hard_force_n,
            "limits.hard_force_n",
            f"expected more than limits.collision_force_n = {limits.collision_force_n}, got {limits.hard_force_n}",
        ),
        (
            theta < 1 / math.sqrt(inputs),
            "classifier.theta",
            f"expected less than 1/sqrt({inputs}) with encoding {encoding!r}, got {theta}",
        ),
        (
            parts.clearance_mm < parts.peg_width_mm,
            "parts.clearance_mm",
            f"expected less than parts.peg_width_mm = {parts.peg_width_mm}, got {parts.clearance_mm}",
        ),
        (
            parts.peg_breadth_mm >= LEAST_BREADTH_MM if parts.shape == "rectangle" else parts.peg_breadth_mm == 0.0,
            "parts.peg_breadth_mm",
            f"expected at least {LEAST_BREADTH_MM} with shape 'rectangle' and 0 with any other, got "
            f"{parts.peg_breadth_mm} and {parts.shape!r}",
        ),
        (
            dip_mm < height_mm or _aside_mm(definition) < room_mm,
            "start.height_mm",
            f"expected more than {dip_mm:.3f}, or the tilted tip starts inside the material, got {height_mm}",
        ),
        (
            (sensor.full_scale_n == 0) == (sensor.full_scale_dnm == 0),
            "sensor.full_scale_dnm",
            f"expected 0 if and only if sensor.full_scale_n = {sensor.full_scale_n} is, got {sensor.full_scale_dnm}",
        ),
        (
            wrist.sensor_mount == "given" or mount == (0.0, 0.0, 0.0),
            "wrist.sensor_mount",
            f"expected 'given' with angles of the sensor, got {wrist.sensor_mount!r} and {mount}",
        ),
        (
            sensor.full_scale_n == 0 or sensor.full_scale_n >= limits.hard_force_n,
            "sensor.full_scale_n",
            f"expected 0 or at least limits.hard_force_n = {limits.hard_force_n}, got {sensor.full_scale_n}",
        ),
        *_moves_rules(definition.moves),
        *_start_rules(definition.start),
        (
            not isinstance(definition.learner, FeltModel)
            or definition.learner.search_moves == 0
            or len(lateral_moves(definition.moves)) == 4,
            "learner.search_moves",
            "expected moves along +X, -X, +Y and -Y alone in moves.list, to search with",
        ),
        (
            not isinstance(definition.policy, Thompson) or isinstance(definition.learner, FeltModel | Plugin),
            "policy.kind",
            f"expected learner.kind = 'felt' with it, got {_kind(definition)!r}, which has nothing to draw from",
        ),
        (
            not isinstance(classifier, Unclassified) or not isinstance(definition.learner, TdSettings),
            "classifier.kind",
            f"expected one that tells states apart with learner.kind = {_kind(definition)!r}, got 'none'",
        ),
        (
            felt.torque == "lever" or felt.lever_mm == 0.0,
            "felt.lever_mm",
            f"expected 0 with felt.torque = {felt.torque!r}, which does not ask for it, got {felt.lever_mm}",
        ),
        (
            shaping.price_per_n == 0.0 or gamma is None or shaping.gamma == gamma,
            "shaping.gamma",
            f"expected learner.gamma = {gamma}, or the price of force changes what is best, got {shaping.gamma}",
        ),
        (
            stiffness == 0.0 or stiffness >= _SOFTEST_N_PER_MM,
            "contact.stiffness_n_per_mm",
            f"expected 0 for a rigid peg or at least {_SOFTEST_N_PER_MM}, got {stiffness}",
        ),
    )
    broken = next(((key, complaint) for holds, key, complaint in rules if not holds), None)
    return broken or obstruction(definition) or _bad_change(definition)


def _bad_change(definition: Definition) -> tuple[str, str] | None:
    """Return why a definition cannot change as it says, None when it can: each phase is a definition of its own."""
    episodes = [change.episode for change in definition.changes]
    if episodes != sorted(episodes):
        return "changes", f"expected the order of the episodes, got {episodes}"
    for first, settings in list(phases(definition))[1:]:
        try:
            convert(to_builtins(settings), Definition)
        except ValidationError as error:
            what, _, key = in_words(str(error)).partition(" - at `$.")
            return "changes", f"in episode {first}: {key.rstrip('`')}: {what[0].lower()}{what[1:]}"
        if conflict := contradiction(settings):
            return "changes", f"in episode {first}: {conflict[0]}: {conflict[1]}"
    return None


def _moves_rules(moves: Moves) -> tuple[tuple[bool, str, str], ...]:
    """Return the rules of a list of moves; every list that is not given holds them."""
    names = [move.name for move in moves.list]
    twice = next((name for name in names if names.count(name) > 1), None)
    still = next((move.name for move in moves.list if not any(increments(Moves(list=(move,)))[0])), None)
    forward = not moves.list or any(move.z_mm > 0.0 for move in moves.list)
    bounds, back = moves.continuous, any(move.z_mm < 0.0 for move in moves.list)
    return (
        (twice is None, "moves.list", f"expected names that differ, got {twice!r} twice"),
        (still is None, "moves.list", f"expected moves that go somewhere, got {still!r}, which does not"),
        (forward, "moves.list", "expected a move with z_mm above 0, which is the way to insertion, got none"),
        (
            not bounds.any or bounds.z_mm > 0.0,
            "moves.continuous.z_mm",
            "expected more than 0 where there are bounds, as it is the way to insertion, got 0",
        ),
        (
            bounds.back_mm == 0.0 or back,
            "moves.continuous.back_mm",
            f"expected 0 without a listed move back out, which such a move would count as, got {bounds.back_mm}",
        ),
    )


def _start_rules(start: Start) -> tuple[tuple[bool, str, str], ...]:
    """Return the rules of a start that is rounded: its middle and its spreads have no more decimals than that."""
    names = ("x_mm", "y_mm", "height_mm", "rx_deg", "ry_deg", "rz_deg", *SPREADS)
    return tuple(
        (
            start.decimals == 0 or round(value, start.decimals) == value,
            f"start.{name}",
            f"expected no more decimals than start.decimals = {start.decimals}, got {value}",
        )
        for name in names
        for value in (getattr(start, name),)
    )


def _kind(definition: Definition) -> object:
    return definition.learner.__struct_config__.tag


def discount_of(learner: LearnerSettings) -> float | None:
    """Return the discount factor that a learner learns with; None where only a plug-in knows it."""
    if isinstance(learner, Plugin):
        gamma = learner.settings.get("gamma")
        return gamma if isinstance(gamma, float) else None
    return learner.gamma


def _dip_mm(definition: Definition) -> float:
    """Return how far the edge of the most tilted tip that an episode may start with is below the tip's centre."""
    parts, start = definition.parts, definition.start
    x_spread_mm, y_spread_mm, rx_spread_deg, ry_spread_deg, _ = start.spreads
    tilt_x, tilt_y = map(math.radians, definition.hole.most_deg)
    rx = math.radians(abs(start.rx_deg) + rx_spread_deg) + tilt_x
    ry = math.radians(abs(start.ry_deg) + ry_spread_deg) + tilt_y
    # The flat face of a tilted hole rises on one side, and the centre of the tip is nearer to it.
    rise_mm = (abs(start.x_mm) + x_spread_mm) * math.sin(tilt_y) + (abs(start.y_mm) + y_spread_mm) * math.sin(tilt_x)
    rise_mm += start.height_mm * (1.0 - math.cos(tilt_x) * math.cos(tilt_y))
    slope_x, slope_y = math.sin(ry), math.cos(ry) * math.sin(rx)
    section = CrossSection(parts)
    if section.is_round:
        return rise_mm + section.radius_mm * math.hypot(slope_x, slope_y)
    return rise_mm + max(slope_x * abs(x_mm) + slope_y * abs(y_mm) for x_mm, y_mm in section.corners)


def _aside_mm(definition: Definition) -> float:
    """Return how far the tip that an episode starts with can reach beyond a centred one, across the hole."""
    parts, start = definition.parts, definition.start
    x_spread_mm, y_spread_mm, _, _, rz_spread_deg = start.spreads
    x_mm, y_mm = abs(start.x_mm) + x_spread_mm, abs(start.y_mm) + y_spread_mm
    tilt_x, tilt_y = map(math.radians, definition.hole.most_deg)
    x_mm, y_mm = x_mm + start.height_mm * math.sin(tilt_y), y_mm + start.height_mm * math.sin(tilt_x)
    section = CrossSection(parts)
    if section.is_round:
        return math.hypot(x_mm, y_mm)
    turn = math.radians(abs(start.rz_deg) + rz_spread_deg)
    turned = [_turned(corner, turn * n / _TURNS) for corner in section.corners for n in range(-_TURNS, _TURNS + 1)]
    # How far aside a point is is convex in where it is: the farthest is at a corner of the range of offsets.
    shifts = [(sx * x_mm, sy * y_mm) for sx in (-1.0, 1.0) for sy in (-1.0, 1.0)]
    reach_mm = max(section.aside(cx + dx, cy + dy) for cx, cy in turned for dx, dy in shifts)
    return reach_mm - section.half_width_mm


def _turned(corner: Corner, angle: float) -> Corner:
    cosine, sine = math.cos(angle), math.sin(angle)
    return corner[0] * cosine - corner[1] * sine, corner[0] * sine + corner[1] * cosine


def obstruction(definition: Definition) -> tuple[str, str] | None:
    """Return a limit that episodes of a definition would run into, as key and complaint; None when there is none.

    A refused motion ends a run for good, so the guard has to let everything pass that a task may ask for. How far an
    episode wanders cannot be known; ``workspace_mm`` and ``workspace_deg`` are the user's own to choose.
    """
    limits = definition.limits
    needed_n = math.ceil(100.0 * ForceBound(definition).needed_n) / 100.0
    if limits.hard_force_n < needed_n:
        why = f"limits.collision_force_n = {limits.collision_force_n} and what a move can add to it on this wrist"
        return "limits.hard_force_n", f"expected at least {needed_n} for {why}, got {limits.hard_force_n}"
    if 0.0 < limits.deepest_mm < reach_mm(definition) - _ROUNDING:
        expected = f"expected 0, or at least {reach_mm(definition):.3f} for an episode to succeed"
        return "limits.deepest_mm", f"{expected}, got {limits.deepest_mm}"
    return None


def reach_mm(definition: Definition) -> float:
    """Return the greatest depth below the mouth [mm] that an episode commands: that of success and one step more."""
    limits = definition.limits
    step_mm = max(increment.dz_mm for increment in extremes(definition.moves))
    return limits.success_fraction * definition.parts.peg_height_mm + step_mm
