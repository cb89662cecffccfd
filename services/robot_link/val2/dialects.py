"""What controllers say and want to hear: all texts of the terminal, as data.

How sure each row is: S two sources, L one source or an inference, U not public and assumed. A row that proves wrong on
a real controller is changed here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Name = Literal["val2", "vplus"]


@dataclass(frozen=True)
class Dialect:
    """The texts of one family of controllers."""

    idle_prompt: str = "."
    """At the start of a line, no program runs (S)."""
    busy_prompt: str = "*"
    """The same while one runs (S); alone and followed by silence, for error lines begin alike (L)."""
    error_begins: str = "*"
    """How a line begins that says why not (U; one line between asterisks, from general memory)."""
    questions: tuple[tuple[str, str], ...] = ()
    """How lines begin that wait for an answer, and what to answer. Never one that erases or loads anything."""
    end_of_line: str = "\r"
    """What sends a command off (U)."""
    kill_line: str = "\x15"
    """What makes the controller forget a line that is not sent off yet (U)."""
    abort: str = "ABORT"
    """Stops a motion (U)."""
    abort_refused_is_fine: bool = True
    """With nothing to stop, some controllers complain."""
    status: str = "STATUS"
    """(U)"""
    where: str = "WHERE"
    """Prints where the arm is: six numbers in a line, X Y Z O A T (U)."""
    speed: str = "SPEED {percent:g}"
    """(S; drafts of 1977-79)"""
    move_by: str = "DO MOVE HERE:{trans}"
    """One increment in the tool frame (S; thesis)."""
    move_to: str = "DO MOVE {location}"
    """To a taught location (L)."""
    probe: str = "DO SET {location} = HERE:TRANS(0,0,0,0,0,0)"
    """Makes a location without moving anything (L)."""
    list_location: str = "LISTL {location}"
    """Prints a location: six numbers in a line, perhaps after its name (L)."""
    assign: str = "DO {variable} = {value}"
    """Sets a variable (L)."""


DIALECTS: Mapping[Name, Dialect] = {
    "val2": Dialect(
        questions=(
            ("Load VAL", "N"),  # L: asked first by a machine without VAL in EPROM; N leaves the disk alone
            ("Initialize", "N"),  # S: Y would erase programs and locations
        ),
    ),
    "vplus": Dialect(
        error_begins="*",
        questions=(("Are you sure", "N"),),
        speed="SPEED {percent:g} MONITOR",  # L
        status="STATUS",
        abort="ABORT",
    ),
}
"""By name; ``vplus`` stands for the RX90 (CS7 controller), which took the same DO MOVE lines unchanged (thesis)."""
