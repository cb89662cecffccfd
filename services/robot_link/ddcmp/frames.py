"""DDCMP frames: what goes into them, their bytes, and finding them in a stream that may be damaged. Pure.

A header is 8 bytes: class, 5 bytes, CRC. A data or maintenance frame goes on with its payload and the payload's CRC.
The decoder hunts for a class byte with a good header CRC, one byte at a time. The protocol knows no escape, so two
holes remain that no decoder can close. A payload which holds a whole frame can be taken for that frame when the header
in front of it is damaged. A header can be taken for a payload of 6 bytes, which ends with the same CRC, where exactly
8 bytes get lost or come twice. Text that begins with the prefix of a logical unit is neither.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import IntEnum
from typing import TypeAlias

from services.robot_link.ddcmp.crc16 import crc16, with_crc

DATA, CONTROL, MAINTENANCE = 0x81, 0x05, 0x90
"""Class bytes."""
FILL = b"\xff\x96"
"""Bytes that may stand between frames in any number."""
QUICK_SYNC_AND_SELECT = 0xC0
"""Flags in byte 2. A standard peer sets both on STRT, STACK and maintenance frames alone, VAL II on every frame."""
HEADER_LENGTH = 8
CRC_LENGTH = 2
LONGEST = 0x3FFF
"""Most bytes in one payload; the count has 14 bits."""
_ADDRESS = 1
_CLASS = re.compile(rb"[\x81\x05\x90]")


class Control(IntEnum):
    """Type byte of a control frame."""

    ACK = 1
    NAK = 2
    REP = 3
    STRT = 6
    STACK = 7


class Reason(IntEnum):
    """Why a NAK is sent."""

    HEADER_CRC = 1
    DATA_CRC = 2
    REPLY = 3
    """The answer to a REP whose message has not come."""
    NO_BUFFER = 8
    OVERRUN = 9
    TOO_LONG = 16
    HEADER_FORMAT = 17


@dataclass(frozen=True)
class Data:
    """One message, number modulo 256; ``response`` acknowledges the other side's up to there."""

    number: int
    response: int
    payload: bytes


@dataclass(frozen=True)
class Ack:
    """All up to ``response`` has come."""

    response: int


@dataclass(frozen=True)
class Nak:
    """All up to ``response`` has come, and something after it was wrong; a reason unknown to ``Reason`` is kept."""

    reason: int
    response: int


@dataclass(frozen=True)
class Rep:
    """Has all up to ``number`` come?"""

    number: int


@dataclass(frozen=True)
class Strt:
    """Begin."""


@dataclass(frozen=True)
class Stack:
    """Begin, for I have heard your STRT."""


@dataclass(frozen=True)
class Maintenance:
    """A maintenance message, which we take from the line and never send."""

    payload: bytes


@dataclass(frozen=True)
class Fault:
    """Something in the stream that is no good frame; ``response`` if its header could still be read."""

    reason: Reason
    response: int | None = None


Sendable: TypeAlias = Data | Ack | Nak | Rep | Strt | Stack
Received: TypeAlias = Sendable | Maintenance | Fault


def encode(frame: Sendable, flags: int = QUICK_SYNC_AND_SELECT) -> bytes:
    """Return the bytes of a frame. ``flags`` is 0 or both; STRT and STACK carry both always. Raises ValueError."""
    if isinstance(frame, Data):
        count = len(frame.payload)
        if not 1 <= count <= LONGEST:
            raise ValueError(f"DDCMP data frame: expected 1 to {LONGEST} bytes, got {count}")
        low, high = count & 0xFF, count >> 8 | flags
        header = bytes((DATA, low, high, frame.response, frame.number, _ADDRESS))
        return with_crc(header) + with_crc(frame.payload)
    if isinstance(frame, Ack):
        fields = (Control.ACK, flags, frame.response, 0)
    elif isinstance(frame, Nak):
        fields = (Control.NAK, frame.reason | flags, frame.response, 0)
    elif isinstance(frame, Rep):
        fields = (Control.REP, flags, 0, frame.number)
    else:
        fields = (Control.STRT if isinstance(frame, Strt) else Control.STACK, QUICK_SYNC_AND_SELECT, 0, 0)
    return with_crc(bytes((CONTROL, *fields, _ADDRESS)))


class Decoder:
    """Finds frames in a stream that comes in any pieces; keeps no more than one frame."""

    def __init__(self, max_message: int = 512) -> None:
        """Take payloads of at most ``max_message`` bytes; longer ones become faults."""
        self._max_message = max_message
        self._buffer = bytearray()
        self._header: bytes | None = None
        self._skip = 0
        self._in_step = False

    @property
    def busy(self) -> bool:
        """Whether a frame has begun and not ended."""
        return bool(self._buffer or self._skip or self._header is not None)

    def feed(self, data: bytes) -> list[Received]:
        """Take bytes; return what they complete, in order."""
        self._buffer += data
        received: list[Received] = []
        while self._take_piece(received):
            pass
        return received

    def give_up(self) -> list[Received]:
        """Forget what has begun, since nothing more came of it; return what that leaves, faults as a rule."""
        received: list[Received] = []
        while self.busy:
            if self._header is not None:
                received.append(Fault(Reason.DATA_CRC, self._header[3]))
                self._buffer.clear()
            elif self._buffer:
                self._out_of_step(received)
                del self._buffer[0]
            self._header, self._skip = None, 0
            while self._take_piece(received):
                pass
        return received

    def _take_piece(self, received: list[Received]) -> bool:
        """Take one piece off the buffer; return whether there may be another."""
        if self._skip:
            skipped = min(self._skip, len(self._buffer))
            del self._buffer[:skipped]
            self._skip -= skipped
            return not self._skip
        if self._header is not None:
            return self._payload(self._header, received)
        start = _CLASS.search(self._buffer)
        before = start.start() if start else len(self._buffer)
        if self._buffer[:before].strip(FILL):
            self._out_of_step(received)
        del self._buffer[:before]
        if len(self._buffer) < HEADER_LENGTH:
            return False
        header = bytes(self._buffer[:HEADER_LENGTH])
        if crc16(header):
            self._out_of_step(received)
            del self._buffer[0]
            return True
        self._in_step = True
        del self._buffer[:HEADER_LENGTH]
        if header[0] == CONTROL:
            received.append(_control(header))
        else:
            self._begin_payload(header, received)
        return True

    def _out_of_step(self, received: list[Received]) -> None:
        """Report that framing is lost: once, since what follows until the next good header says nothing new."""
        if self._in_step:
            received.append(Fault(Reason.HEADER_CRC))
        self._in_step = False

    def _begin_payload(self, header: bytes, received: list[Received]) -> None:
        count = _count(header)
        response = header[3] if header[0] == DATA else None
        if header[5] != _ADDRESS or not count:
            received.append(Fault(Reason.HEADER_FORMAT, response))
            self._in_step = bool(count)  # without a count there is no telling where the next frame begins
            self._skip = count + CRC_LENGTH if count else 0
        elif count > self._max_message:
            received.append(Fault(Reason.TOO_LONG, response))
            self._skip = count + CRC_LENGTH
        else:
            self._header = header

    def _payload(self, header: bytes, received: list[Received]) -> bool:
        length = _count(header) + CRC_LENGTH
        if len(self._buffer) < length:
            return False
        sealed = bytes(self._buffer[:length])
        del self._buffer[:length]
        self._header = None
        is_data = header[0] == DATA
        if crc16(sealed):
            received.append(Fault(Reason.DATA_CRC, header[3] if is_data else None))
        elif is_data:
            received.append(Data(number=header[4], response=header[3], payload=sealed[:-CRC_LENGTH]))
        else:
            received.append(Maintenance(sealed[:-CRC_LENGTH]))
        return True


def _count(header: bytes) -> int:
    return header[1] | (header[2] & 0x3F) << 8


def _control(header: bytes) -> Received:
    """Return the control frame of a header whose CRC is good. Q and S are not looked at: VAL II sets them always."""
    _, kind, subtype, response, number, address, _, _ = header
    if address != _ADDRESS:
        return Fault(Reason.HEADER_FORMAT)
    if kind == Control.ACK:
        return Ack(response)
    if kind == Control.NAK:
        return Nak(subtype & 0x3F, response)
    if kind == Control.REP:
        return Rep(number)
    if kind == Control.STRT:
        return Strt()
    if kind == Control.STACK:
        return Stack()
    return Fault(Reason.HEADER_FORMAT)
