"""The drive's side of TU58's Radial Serial Protocol, as a pure machine: bytes in, bytes out.

What a real drive does by its motor (retries, seek, self-test) always succeeds here. A bad checksum is answered with an
END (data check); bytes that cannot be a packet make the drive call with INIT until it is spoken to, as after power-up.
A WRITE reaches the disk in one piece when its last byte has come, so an interrupted one has written nothing.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING

from treenail.tools.pfloppy.disk_errors import DiskError, MissingError, ProtectedError
from treenail.tools.pfloppy.tu58 import (
    CONTROL_BYTES,
    DATA_BYTES,
    OVERHEAD,
    Control,
    Flag,
    Modifier,
    Opcode,
    Success,
    Switch,
    control_of,
    message_of,
    packet,
)

if TYPE_CHECKING:
    from treenail.tools.pfloppy.protocols import Disk

BLOCK = 512
RECORD = 128
_DONE_AT_ONCE = (
    Opcode.NOP,
    Opcode.DIAGNOSE,
    Opcode.GET_STATUS,
    Opcode.SET_STATUS,
    Opcode.GET_CHARACTERISTICS,
)
"""Answered with END alone; to GET CHARACTERISTICS that means: can do MRSP."""


class Tu58Drive:
    """One drive with the units' disks; it has just been switched on."""

    summary = "TU58 Radial Serial Protocol, a STAND-IN: the protocol of VAL II's own floppy drive is not publicly known"

    def __init__(self, disks: Sequence[Disk]) -> None:
        self._disks = tuple(disks)
        self._inbox = bytearray()
        self._out: deque[bytes] = deque()
        self._held = self._mrsp = self._init_seen = False
        self._write: Control | None = None
        self._data = bytearray()
        self._calling = True
        self._out.append(bytes((Flag.INIT,)))

    def receive(self, data: bytes) -> None:
        """Take bytes from the controller."""
        if data and self._calling:
            self._calling = False
            self._out.clear()
        self._inbox += data
        while self._inbox and self._take():
            pass

    def transmit(self) -> bytes:
        """Return the next packet, or the next byte under MRSP; nothing while the controller holds."""
        if not self._out or self._held:
            return b""
        if not self._mrsp:
            return self._out.popleft()
        first = self._out.popleft()
        if len(first) > 1:
            self._out.appendleft(first[1:])
        self._held = True
        return first[:1]

    def silence(self) -> None:
        """Give up a packet that does not go on; call with INIT if that is due."""
        if self._inbox:
            self._complain()
        elif self._calling:
            self._out.append(bytes((Flag.INIT,)))

    def _reset(self) -> None:
        self._inbox.clear()
        self._out.clear()
        self._held = self._mrsp = self._init_seen = False
        self._write, self._data = None, bytearray()

    def _complain(self) -> None:
        """Forget everything and call the controller, which has to begin anew."""
        self._reset()
        self._calling = True
        self._out.append(bytes((Flag.INIT,)))

    def _take(self) -> bool:
        """Take one flag or packet off the inbox; return whether there was a whole one."""
        flag = self._inbox[0]
        if flag in (Flag.COMMAND, Flag.DATA, Flag.BOOT):
            return self._take_packet(flag)
        del self._inbox[0]
        second_init = flag == Flag.INIT and self._init_seen
        self._init_seen = flag == Flag.INIT and not second_init
        if second_init:
            rest = bytes(self._inbox)
            self._reset()
            self._inbox += rest
            self._out.append(bytes((Flag.CONTINUE,)))
        elif flag in (Flag.CONTINUE, Flag.XON):
            self._held = False
        elif flag == Flag.XOFF:
            self._held = True
        elif flag not in (Flag.NONE, Flag.INIT):
            self._complain()
        return True

    def _take_packet(self, flag: int) -> bool:
        """Take what has a length: a packet, or BOOT and its unit."""
        self._init_seen = False
        if len(self._inbox) < 2:
            return False
        length = self._inbox[1]
        if flag == Flag.BOOT:
            del self._inbox[:2]
            self._boot(length)
            return True
        fits = length == CONTROL_BYTES if flag == Flag.COMMAND else 0 < length <= DATA_BYTES and self._write is not None
        if not fits:
            self._complain()
            return False
        if len(self._inbox) < length + OVERHEAD:
            return False
        message = message_of(bytes(self._inbox[: length + OVERHEAD]))
        del self._inbox[: length + OVERHEAD]
        self._held = False
        if flag == Flag.COMMAND:
            self._command(message)
        else:
            self._more(message)
        return True

    def _command(self, message: bytes | None) -> None:
        """Begin a command; whatever was going on is given up, as its controller has given it up."""
        self._out.clear()
        self._write = None
        if message is None:
            self._end(Control(Opcode.NOP), Success.DATA_CHECK)
            return
        command = control_of(message)
        self._mrsp = bool(command.switches & Switch.MRSP)
        if command.opcode in _DONE_AT_ONCE:
            self._end(command, Success.GOOD)
        elif command.opcode == Opcode.INIT:
            rest, mrsp = bytes(self._inbox), self._mrsp
            self._reset()
            self._inbox += rest
            self._mrsp = mrsp
            self._end(command, Success.GOOD)
        elif command.opcode in (Opcode.READ, Opcode.WRITE, Opcode.POSITION):
            self._transfer(command)
        else:
            self._end(command, Success.BAD_OPCODE)

    def _transfer(self, command: Control) -> None:
        if command.unit >= len(self._disks):
            self._end(command, Success.BAD_UNIT)
        elif _offset(command) >= self._disks[command.unit].size:
            self._end(command, Success.BAD_BLOCK)
        elif command.opcode == Opcode.READ:
            self._read(command)
        elif command.opcode == Opcode.WRITE and command.count:
            self._write, self._data = command, bytearray()
            self._out.append(bytes((Flag.CONTINUE,)))
        else:
            self._end(command, Success.GOOD)

    def _read(self, command: Control) -> None:
        count, success = self._room(command)
        try:
            data = self._disks[command.unit].read(_offset(command), count) if count else b""
        except DiskError as error:
            self._end(command, _code(error))
            return
        for begin in range(0, count, DATA_BYTES):
            self._out.append(packet(Flag.DATA, data[begin : begin + DATA_BYTES]))
        self._end(command, success, count)

    def _more(self, message: bytes | None) -> None:
        """Take a data packet of the WRITE that goes on; write when it was the last."""
        command = self._write
        assert command is not None
        count, success = self._room(command)
        if message is None or len(self._data) + len(message) > command.count:
            self._write = None
            self._end(command, Success.DATA_CHECK)
            return
        self._data += message
        if len(self._data) < count:
            self._out.append(bytes((Flag.CONTINUE,)))
            return
        self._write = None
        failure = self._store(command, bytes(self._data[:count]))
        self._end(command, success if failure is None else failure, count if failure is None else 0)

    def _store(self, command: Control, data: bytes) -> Success | None:
        """Write to the disk, the last block filled with zeros; return what went wrong."""
        disk, offset = self._disks[command.unit], _offset(command)
        data += bytes(-len(data) % _unit_of_address(command))
        try:
            disk.write(offset, data)
            if command.modifier & Modifier.VERIFY and disk.read_back(offset, len(data)) != data:
                return Success.DATA_CHECK
        except DiskError as error:
            return _code(error)
        return None

    def _room(self, command: Control) -> tuple[int, Success]:
        """Return how many of the bytes asked for are before the end of the medium, and what to call that."""
        count = min(command.count, self._disks[command.unit].size - _offset(command))
        return count, Success.GOOD if count == command.count else Success.PARTIAL

    def _boot(self, unit: int) -> None:
        """Send block 0 without any packet; a unit that is not there has nothing to say."""
        self._out.clear()
        self._write, self._held, self._mrsp = None, False, False
        if unit >= len(self._disks):
            self._complain()
            return
        try:
            self._out.append(self._disks[unit].boot())
        except DiskError:
            self._complain()

    def _end(self, command: Control, success: Success, count: int = 0) -> None:
        self._out.append(Control(Opcode.END, success, command.unit, count=count).encode())


def _unit_of_address(command: Control) -> int:
    return RECORD if command.modifier & Modifier.RECORDS else BLOCK


def _offset(command: Control) -> int:
    return command.block * _unit_of_address(command)


def _code(error: DiskError) -> Success:
    """Return what to call a refusal of the disk."""
    if isinstance(error, ProtectedError):
        return Success.WRITE_PROTECTED
    return Success.NO_CARTRIDGE if isinstance(error, MissingError) else Success.DATA_CHECK
