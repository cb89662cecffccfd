"""Packets of TU58's Radial Serial Protocol: numbers, checksum, bytes both ways. Pure."""

from __future__ import annotations

import struct
from dataclasses import astuple, dataclass
from enum import IntEnum, IntFlag

CONTROL_BYTES = 10
"""Message bytes of a control packet; with flag, length and checksum it has 14."""
DATA_BYTES = 128
"""Most message bytes of a data packet."""
OVERHEAD = 4
"""Bytes of a packet besides its message: flag, length, checksum."""
_CONTROL = struct.Struct("<BBBBHHH")
_WORD = struct.Struct("<H")


class Flag(IntEnum):
    """First byte of everything on the wire."""

    NONE = 0x00
    """Also what a BREAK is received as."""
    DATA = 0x01
    COMMAND = 0x02
    INIT = 0x04
    BOOT = 0x08
    CONTINUE = 0x10
    XON = 0x11
    XOFF = 0x13


class Opcode(IntEnum):
    """What a control packet wants."""

    NOP = 0
    INIT = 1
    READ = 2
    WRITE = 3
    POSITION = 5
    DIAGNOSE = 7
    GET_STATUS = 8
    SET_STATUS = 9
    GET_CHARACTERISTICS = 10
    END = 0x40


class Modifier(IntFlag):
    """How to do it."""

    VERIFY = 0x01
    """WRITE: read back and compare. READ: with less signal, which means nothing here."""
    RECORDS = 0x80
    """The block number counts records of 128 bytes."""


class Switch(IntFlag):
    """How to talk."""

    MRSP = 0x08
    """The drive waits for CONTINUE after every byte that it sends."""
    MAINTENANCE = 0x10
    """No retries; means nothing here."""


class Success(IntEnum):
    """Success byte of an END packet."""

    GOOD = 0x00
    GOOD_AFTER_RETRY = 0x01
    SELF_TEST_FAILED = 0xFF
    PARTIAL = 0xFE
    """The end of the medium came first; the count says how much was done."""
    BAD_UNIT = 0xF8
    NO_CARTRIDGE = 0xF7
    WRITE_PROTECTED = 0xF5
    DATA_CHECK = 0xEF
    SEEK_ERROR = 0xE0
    MOTOR_STOPPED = 0xDF
    BAD_OPCODE = 0xD0
    BAD_BLOCK = 0xC9


@dataclass(frozen=True)
class Control:
    """A control packet: a command, or the END of one."""

    opcode: int
    modifier: int = 0
    """Success byte of an END."""
    unit: int = 0
    switches: int = 0
    sequence: int = 0
    count: int = 0
    block: int = 0
    """Summary word of an END."""

    def encode(self) -> bytes:
        """Return the whole packet. struct.error for a number that does not fit its field."""
        return packet(Flag.COMMAND, _CONTROL.pack(*astuple(self)))


def checksum(data: bytes) -> int:
    """Return the sum of little-endian words, each carry out of bit 15 added back in; an odd end is padded with 0."""
    padded = data + b"\0" * (len(data) % 2)
    total: int = sum(word for (word,) in _WORD.iter_unpack(padded))
    while total > 0xFFFF:
        total = (total & 0xFFFF) + (total >> 16)
    return total


def packet(flag: int, message: bytes) -> bytes:
    """Return flag, length, message and checksum. ValueError for more than 255 bytes."""
    head = bytes((flag, len(message))) + message
    return head + _WORD.pack(checksum(head))


def message_of(whole: bytes) -> bytes | None:
    """Return the message of a whole packet, or None when its length or checksum is wrong."""
    if len(whole) < OVERHEAD or len(whole) != whole[1] + OVERHEAD:
        return None
    (given,) = _WORD.unpack(whole[-2:])
    return whole[2:-2] if given == checksum(whole[:-2]) else None


def control_of(message: bytes) -> Control:
    """Return the fields of a control packet's message of 10 bytes."""
    return Control(*_CONTROL.unpack(message))
