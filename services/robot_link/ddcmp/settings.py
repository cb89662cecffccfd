"""Settings of one end of a DDCMP line: V+'s values, since VAL II's own are not known."""

from __future__ import annotations

from dataclasses import dataclass

from services.robot_link.ddcmp.frames import LONGEST
from services.rules.settings import check, setting
from services.wire.errors import TreenailError

MODULUS = 256
"""Message numbers go round after so many."""


class DdcmpError(TreenailError):
    """A DDCMP line that is used wrongly, or set up with values that it cannot have."""


@dataclass(frozen=True)
class DdcmpSettings:
    """How one end behaves. Raises DdcmpError for values out of range."""

    reply_timer_s: float = setting(
        3.0, "ask again, or begin again, after so long [s]", "--ddcmp-timer", metavar="S", within=(0.01, 255.0)
    )
    """Wait so long [s] for an acknowledgement before asking with REP (V+: 3)."""
    start_timer_s: float = setting(3.0, within=(0.01, 255.0))
    """Repeat STRT and STACK so often [s] (V+: 3)."""
    listen_s: float = setting(
        0.0,
        "wait so long for the controller to begin before we do [s]",
        "--ddcmp-listen",
        metavar="S",
        within=(0.0, 255.0),
    )
    """Wait so long [s] for the peer's STRT before sending our own."""
    gap_s: float = setting(1.0, within=(0.01, 255.0))
    """A frame that has begun and gets no byte for so long [s] is given up (ours; V+'s is not known)."""
    nak_pause_s: float = setting(1.0, within=(0.0, 255.0))
    """Ask for the same message again only after so long [s]; it may be under way (ours)."""
    byte_s: float = setting(0.0, within=(0.0, 1.0))
    """Time of one byte on the line [s], so that timers begin when a frame has left; 0 for a fast line."""
    most_timeouts: int = setting(8, within=(1, 255))
    """So many in a row may happen; one more halts the line (V+: 8)."""
    most_naks: int = setting(8, within=(1, 255))
    """So many may come in a row; one more halts the line (V+: 8)."""
    max_message: int = setting(512, within=(1, LONGEST))
    """Most bytes in a message, either way (V+: 512)."""
    window: int = setting(MODULUS - 1, within=(1, MODULUS - 1))
    """Most messages sent and not yet acknowledged. At 255 an acknowledgement that comes a second time, late,
    cannot be told from a new one; a serial line never does that."""
    buffers: int = setting(10, within=(1, 10_000))
    """Messages kept until they are read; those after them are refused (V+: 10)."""
    flags_on_all: bool = True
    """Q and S on every frame as VAL II sets them; otherwise on STRT and STACK alone as the standard says."""
    fill: bytes = b""
    """Bytes before and after every frame, FF and 96 only (VAL II's controller sends FF FF, its host need not)."""

    def __post_init__(self) -> None:
        check(self, DdcmpError, "DDCMP: ")
        if self.fill.strip(b"\xff\x96"):
            raise DdcmpError(f"DDCMP: fill: expected bytes FF and 96 only, got {self.fill.hex(' ')}")
