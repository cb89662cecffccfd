"""RDT, raw data transfer, by the byte. Pure.

All big-endian. A request has 8 bytes: 1234 hex, command, count. A record has 36: RDT sequence, F/T sequence, status,
and Fx Fy Fz Tx Ty Tz in counts, which are signed. Source: ATI, "Net F/T installation and operation manual", chapter 10.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

PORT = 49152
STOP, STREAM, BIAS, FILTER, RATE = 0x0000, 0x0002, 0x0042, 0x0081, 0x0082
"""Commands; the last two are OnRobot's, whose count is the setting."""
SIZE = 36
WRAP = 1 << 32
_REQUEST = struct.Struct(">HHI")
_RECORD = struct.Struct(">3I6i")
_HEAD = 0x1234

SATURATED, NEAR_SATURATION, LOST, CHANGED, NOT_ZEROED = 1, 2, 4, 8, 16
"""Bits of ``FtPacket.status``."""
_ERROR = 1 << 31
_SATURATION = 1 << 17
# Of a Net F/T. ATI's later sensors have others from 0 to 30, by a public driver of their EtherCAT ones: 30 saturated,
# 29 calibration, 28 a simulated error; there too 31 tells that any is an error. Whichever it is, nothing moves.
_WORDS = {
    30: "CPU or memory, or of an Axia saturated",
    29: "digital board",
    28: "analog board",
    27: "serial link",
    26: "program memory",
    25: "halted by its configuration",
    24: "settings",
    23: "settings and calibration do not fit",
    22: "network",
    21: "CAN",
    20: "RDT",
    19: "EtherNet/IP",
    18: "DeviceNet",
    17: "saturated, or its converter fails",
}


class Record(NamedTuple):
    """One sample."""

    rdt_sequence: int
    """Counts what was sent since the stream was asked for."""
    ft_sequence: int
    """Counts what was measured."""
    status: int
    counts: tuple[int, ...]


def request(command: int, count: int = 0) -> bytes:
    """Return a request; a count of 0 is a stream without end."""
    return _REQUEST.pack(_HEAD, command, count)


def record(data: bytes) -> Record | None:
    """Return the record in a packet, None for one of another length."""
    if len(data) != SIZE:
        return None
    rdt, ft, status, *counts = _RECORD.unpack(data)
    return Record(rdt, ft, status, tuple(counts))


def status_of(status: int) -> int:
    """Return the status bits of a sample: saturated, or lost where any other error is told."""
    others = status & ~_SATURATION & sum(1 << bit for bit in _WORDS)
    saturated = bool(status & _SATURATION)
    return SATURATED * saturated | LOST * bool(others or (status & _ERROR and not saturated))


def troubles(status: int) -> str:
    """Return in words what a status tells; empty for nothing."""
    words = [word for bit, word in _WORDS.items() if status >> bit & 1]
    return ", ".join(words) or ("an error that it does not name" if status & _ERROR else "")
