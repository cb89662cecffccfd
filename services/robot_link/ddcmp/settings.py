"""Settings of one end of a DDCMP line: V+'s values, since VAL II's own are not known."""

from __future__ import annotations

from dataclasses import dataclass

from services.robot_link.ddcmp.frames import LONGEST
from services.wire.errors import TreenailError

MODULUS = 256
"""Message numbers go round after so many."""
_RANGES = {
    "reply_timer_s": (0.01, 255.0),
    "start_timer_s": (0.01, 255.0),
    "listen_s": (0.0, 255.0),
    "gap_s": (0.01, 255.0),
    "nak_pause_s": (0.0, 255.0),
    "byte_s": (0.0, 1.0),
    "most_timeouts": (1, 255),
    "most_naks": (1, 255),
    "max_message": (1, LONGEST),
    "window": (1, MODULUS - 1),
    "buffers": (1, 10_000),
}


class DdcmpError(TreenailError):
    """A DDCMP line that is used wrongly, or set up with values that it cannot have."""


@dataclass(frozen=True)
class DdcmpSettings:
    """How one end behaves. Raises DdcmpError for values out of range."""

    reply_timer_s: float = 3.0
    """Wait so long [s] for an acknowledgement before asking with REP, 0.01 to 255 (V+: 3)."""
    start_timer_s: float = 3.0
    """Repeat STRT and STACK so often [s], 0.01 to 255 (V+: 3)."""
    listen_s: float = 0.0
    """Wait so long [s] for the peer's STRT before sending our own, 0 to 255."""
    gap_s: float = 1.0
    """A frame that has begun and gets no byte for so long [s] is given up, 0.01 to 255 (ours; V+'s is not known)."""
    nak_pause_s: float = 1.0
    """Ask for the same message again only after so long [s], 0 to 255; it may be under way (ours)."""
    byte_s: float = 0.0
    """Time of one byte on the line [s], 0 to 1, so that timers begin when a frame has left; 0 for a fast line."""
    most_timeouts: int = 8
    """So many in a row may happen; one more halts the line (V+: 8)."""
    most_naks: int = 8
    """So many may come in a row; one more halts the line (V+: 8)."""
    max_message: int = 512
    """Most bytes in a message, either way, 1 to 16383 (V+: 512)."""
    window: int = MODULUS - 1
    """Most messages sent and not yet acknowledged, 1 to 255. At 255 an acknowledgement that comes a second time, late,
    cannot be told from a new one; a serial line never does that."""
    buffers: int = 10
    """Messages kept until they are read; those after them are refused (V+: 10)."""
    flags_on_all: bool = True
    """Q and S on every frame as VAL II sets them; otherwise on STRT and STACK alone as the standard says."""
    fill: bytes = b""
    """Bytes before and after every frame, FF and 96 only (VAL II's controller sends FF FF, its host need not)."""

    def __post_init__(self) -> None:
        for name, (least, most) in _RANGES.items():
            value = getattr(self, name)
            if not least <= value <= most:
                raise DdcmpError(f"DDCMP: {name}: expected {least:g} to {most:g}, got {value!r}")
        if self.fill.strip(b"\xff\x96"):
            raise DdcmpError(f"DDCMP: fill: expected bytes FF and 96 only, got {self.fill.hex(' ')}")
