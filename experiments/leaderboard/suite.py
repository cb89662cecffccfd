"""The tasks of the leaderboard: the definitions ``suite-*``, and how much work each is."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from services.wire.definition import Definition
from services.wire.definition_file import load, shipped
from services.wire.errors import TreenailError

PREFIX = "suite-"
CHANGING = "suite-worn"
"""Changes in the course of a run: it is no task of the board itself, see ``lasting``."""
SLOW_MOVES = 200.0
"""An insertion that takes more moves than this is a long one."""
QUICK = (
    "suite-round",
    "suite-round-tight",
    "suite-square",
    "suite-triangle",
    "suite-rubber",
    "suite-stiff-wrist",
    "suite-noisy",
    "suite-chamferless",
)
"""Tasks of the quick form, as far as they are there: moves of 0.2 mm, so that a run takes seconds."""


def tasks(patterns: Sequence[str] | None, quick: bool = False) -> tuple[Definition, ...]:
    """Return the tasks that match shell-style patterns, such as ``suite-round*``; without patterns, all or the quick.

    Raises TreenailError for a pattern that no task matches.
    """
    names = sorted(name for name in shipped() if name.startswith(PREFIX))
    if patterns is None:
        wanted = [name for name in names if (name in QUICK if quick else not name.startswith(CHANGING))]
        return tuple(load(name) for name in wanted)
    for pattern in patterns:
        if pattern != f"{CHANGING}*" and not any(fnmatchcase(name, pattern) for name in names):
            raise TreenailError(f"--tasks: expected some of {', '.join(names)}, or patterns of them, got {pattern!r}")
    return tuple(load(name) for name in names if any(fnmatchcase(name, pattern) for pattern in patterns))


def moves_expected(definition: Definition) -> float:
    """Return about how many moves an insertion takes: down to success, and some to get there."""
    depth_mm = definition.limits.success_fraction * definition.parts.peg_height_mm + definition.start.height_mm
    return 1.2 * depth_mm / definition.moves.insertion_mm


def change_of(definition: Definition) -> int | None:
    """Return the episode at which a task changes, None for one that stays as it is."""
    return definition.changes[0].episode if definition.changes else None
