"""What one end of a DDCMP line says: its state, its events, its counts."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, TypeAlias

from services.robot_link.machine import Table


class State(Enum):
    """Where an end stands."""

    HALTED = "halted"
    LISTENING = "listening for STRT"
    STARTING = "sending STRT"
    ANSWERED = "sending STACK"
    RUNNING = "running"


class What(Enum):
    """What can happen."""

    STARTED_LISTENING = "start, to listen first"
    STARTED = "start"
    TIMED_OUT = "time-out"
    STRT = "STRT came"
    STACK = "STACK came"
    AT_ZERO = "ACK or data with response 0 came"
    FAILED = "failure"


_LIVING = (State.LISTENING, State.STARTING, State.ANSWERED, State.RUNNING)

TRANSITIONS: Table[State, What] = {
    (State.HALTED, What.STARTED_LISTENING): State.LISTENING,
    (State.HALTED, What.STARTED): State.STARTING,
    (State.LISTENING, What.TIMED_OUT): State.STARTING,
    (State.LISTENING, What.STRT): State.ANSWERED,
    (State.STARTING, What.TIMED_OUT): State.STARTING,
    (State.STARTING, What.STRT): State.ANSWERED,
    (State.STARTING, What.STACK): State.RUNNING,
    (State.ANSWERED, What.TIMED_OUT): State.ANSWERED,
    (State.ANSWERED, What.STRT): State.ANSWERED,
    (State.ANSWERED, What.STACK): State.RUNNING,
    (State.ANSWERED, What.AT_ZERO): State.RUNNING,
    **{(state, What.FAILED): State.HALTED for state in _LIVING},
}
"""A start from anywhere halts the line first."""


@dataclass(frozen=True)
class Started:
    """Both ends are at number 0; messages can pass."""


@dataclass(frozen=True)
class Halted:
    """The line has failed; ``restarted`` if it was the peer that began anew."""

    why: str
    restarted: bool = False


@dataclass(frozen=True)
class Refused:
    """A frame came that this end does not take; the line goes on."""

    what: str


Event: TypeAlias = Started | Halted | Refused


class Outcome(NamedTuple):
    """What came of bytes or of time."""

    reply: bytes = b""
    """Bytes to send at once."""
    events: tuple[Event, ...] = ()


@dataclass
class Counts:
    """How a line has fared since it was started."""

    sent: int = 0
    """Messages, each counted once."""
    sent_again: int = 0
    received: int = 0
    """Messages that were new and in sequence."""
    duplicates: int = 0
    out_of_sequence: int = 0
    faults: int = 0
    """Damaged or impossible frames."""
    naks_sent: int = 0
    naks_received: int = 0
    timeouts: int = 0
