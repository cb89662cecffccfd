"""Where the dialogue with a controller's terminal stands, and what leads where."""

from __future__ import annotations

import enum

from services.robot_link.machine import Table


class State(enum.Enum):
    """Where the dialogue stands."""

    DOWN = "down"
    GREETING = "greeting"
    IDLE = "idle"
    ECHO = "echo"
    REPLY = "reply"
    FAILED = "failed"


class What(enum.Enum):
    """What can happen."""

    STARTED = "start"
    PROMPTED = "prompt"
    ASKED = "command"
    ECHOED = "echo complete"
    FAILED = "garbage, silence"


TRANSITIONS: Table[State, What] = {
    **{(state, What.STARTED): State.GREETING for state in State},
    (State.GREETING, What.PROMPTED): State.IDLE,
    (State.IDLE, What.ASKED): State.ECHO,
    (State.ECHO, What.ECHOED): State.REPLY,
    (State.REPLY, What.PROMPTED): State.IDLE,
    **{(state, What.FAILED): State.FAILED for state in State},
}
"""Start-up questions are answered in GREETING and lead nowhere else."""
