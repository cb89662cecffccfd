"""Transition tables of the two old protocols as data, and their diagrams. Pure.

A machine says what has happened; the table alone says where it stands then, and what is not in it cannot be.
``python -m services.robot_link.machine`` prints docs/state_machines.md.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from typing import TypeVar

S = TypeVar("S", bound=enum.Enum)
W = TypeVar("W", bound=enum.Enum)

Table = Mapping[tuple[S, W], S]
"""From a state, and what happens in it, to the next state."""


def following(table: Table[S, W], state: S, what: W) -> S:
    """Return the next state. Raises ValueError for what cannot happen in this one."""
    after = table.get((state, what))
    if after is None:
        possible = ", ".join(other.value for before, other in table if before is state)
        raise ValueError(f"{state.value}: expected one of {possible}, got {what.value}")
    return after


def diagram(table: Table[S, W], initial: S) -> str:
    """Return a table as a state diagram in Mermaid's language, what leads from one state to one other in one line."""
    arrows: dict[tuple[S, S], list[str]] = {}
    for (before, what), after in table.items():
        arrows.setdefault((before, after), []).append(what.value)
    lines = ["```mermaid", "stateDiagram-v2", f"    [*] --> {initial.name}"]
    lines += [f"    {before.name} --> {after.name}: {', '.join(words)}" for (before, after), words in arrows.items()]
    return "\n".join([*lines, "```"])


def page() -> str:
    """Return docs/state_machines.md."""
    from services.robot_link.ddcmp import events as ddcmp
    from services.robot_link.val2 import states as val2

    return f"""# The state machines of the old protocols

Generated from the tables that the machines run by (`python -m services.robot_link.machine`); a test holds it to that.

## The terminal of a VAL II or V+ controller

`services/robot_link/val2/states.py`, used by `terminal.py`.

{diagram(val2.TRANSITIONS, val2.State.DOWN)}

## One end of a DDCMP line

`services/robot_link/ddcmp/events.py`, used by `line.py`.

{diagram(ddcmp.TRANSITIONS, ddcmp.State.HALTED)}
"""


if __name__ == "__main__":
    print(page(), end="")
