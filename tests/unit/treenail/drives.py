"""A drive and the controller that speaks to it, in one process."""

from __future__ import annotations

from typing import TypeVar

from services.robot_link.emulator.floppy import Talk
from treenail.tools.pfloppy.tu58_drive import Tu58Drive

T = TypeVar("T")


def said(drive: Tu58Drive, came: bytes) -> bytes:
    """Return all that a drive says to what comes."""
    drive.receive(came)
    return b"".join(iter(drive.transmit, b""))


def carry_out(drive: Tu58Drive, operation: Talk[T]) -> T:
    """Carry an operation of the controller out; return its result."""
    try:
        sent = next(operation)
        while True:
            came = said(drive, sent)
            assert sent or came, "the drive has nothing to say"
            sent = operation.send(came)
    except StopIteration as finished:
        result: T = finished.value
        return result
