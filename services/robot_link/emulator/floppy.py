"""The controller's side of a floppy drive, for an emulated controller that boots from one, and for trying pfloppy.

Every operation is a generator: it yields bytes to send (perhaps none) and is sent the bytes that came; its value is the
result. It knows TU58's Radial Serial Protocol and pfloppy's directory from their descriptions (docs/pfloppy.md) and
shares no code with the drive, so that a mistake on one side shows.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TypeAlias, TypeVar

from services.robot_link.serial_line import Line
from services.wire.errors import TreenailError

T = TypeVar("T")
Talk: TypeAlias = Generator[bytes, bytes, T]

CODES = {
    0xFF: "self-test failed",
    0xFE: "end of the medium",
    0xF8: "no such unit",
    0xF7: "no cartridge",
    0xF5: "write protected",
    0xEF: "data check",
    0xE0: "seek error",
    0xDF: "motor stopped",
    0xD0: "no such operation",
    0xC9: "no such block",
}
NO_BLOCK = 0xC9
BLOCK = 512
PATIENCE_S = 10.0
"""How long a drive may say nothing."""
_READ, _WRITE, _RECORDS, _MRSP = 2, 3, 0x80, 0x08


class FloppyError(TreenailError):
    """The drive or the disk refuses, or what came from them makes no sense."""


class NoBlockError(FloppyError):
    """The drive says that its medium has no such block."""


@dataclass(frozen=True)
class File:
    """One entry of the directory."""

    slot: int
    name: str
    start: int
    length: int

    @property
    def blocks(self) -> int:
        """How many blocks it fills."""
        return (self.length + BLOCK - 1) // BLOCK


@dataclass(frozen=True)
class Directory:
    """All that is on the disk, as it was read."""

    raw: bytes
    first: int
    data: range
    files: tuple[File, ...]

    def file(self, name: str) -> File:
        """Return a file. Raises FloppyError."""
        for file in self.files:
            if file.name == name:
                return file
        raise FloppyError(f"{name}: no such file on the disk")


def ones_sum(data: bytes) -> int:
    """Return the checksum: words low byte first, added in ones' complement."""
    low, high = sum(data[0::2]), sum(data[1::2])
    total = low + (high << 8)
    return (total - 1) % 0xFFFF + 1 if total else 0


def talk(operation: Talk[T], line: Line, patience_s: float) -> T:
    """Carry one operation out over an open line. Raises FloppyError, LineError."""
    try:
        sent = next(operation)
        while True:
            if sent:
                line.write(sent)
            came = line.read(patience_s)
            if not came:
                raise FloppyError(f"drive: expected an answer within {patience_s:g} s, got none")
            sent = operation.send(came)
    except StopIteration as end:
        result: T = end.value
        return result


def boot_from(line: Line, patience_s: float = PATIENCE_S) -> str:
    """Open a line, start up from the drive at its other end, and return the system's banner.

    Raises FloppyError, LineError.
    """
    line.open()
    try:
        return talk(FloppyClient().boot(), line, patience_s)
    finally:
        line.close()


class FloppyClient:
    """Talks to one unit of a drive; with ``mrsp`` it asks for every byte by itself."""

    def __init__(self, unit: int = 0, mrsp: bool = False) -> None:
        self._unit, self._mrsp = unit, mrsp
        self._came = bytearray()
        self._send = b""

    def wake(self) -> Talk[None]:
        """Break (as the zero byte that it is received as), twice INIT, wait for CONTINUE."""
        came = yield b"\x00\x04\x04"
        while b"\x10" not in came:
            came = yield b""
        self._came.clear()
        self._send = b""

    def boot(self) -> Talk[str]:
        """Read the boot block and the system file that it names; return its first line, the banner."""
        yield from self.wake()
        self._send += bytes((0x08, self._unit))
        block = yield from self._exactly(BLOCK, plain=True)
        if block[:4] != b"BOOT":
            raise FloppyError("boot block: expected one that begins with BOOT; is there a system file on the disk?")
        start, length = int.from_bytes(block[14:16], "little"), int.from_bytes(block[16:20], "little")
        system = yield from self.read(start, length)
        return system.split(b"\n")[0].decode("ascii", "replace").strip()

    def directory(self) -> Talk[Directory]:
        """Read home block and directory."""
        home = yield from self.read(1, BLOCK)
        if home[:10] != b"TREENAIL\x01\x00":
            raise FloppyError(f"home block: expected TREENAIL version 1, got {home[:10]!r}")
        first, many, data, end = (int.from_bytes(home[at : at + 2], "little") for at in (10, 12, 14, 16))
        raw = yield from self.read(first, many * BLOCK)
        entries = (raw[at : at + 16] for at in range(0, len(raw), 16))
        files = tuple(_file(slot, entry) for slot, entry in enumerate(entries) if any(entry))
        return Directory(raw, first, range(data, end), files)

    def load(self, name: str) -> Talk[bytes]:
        """Return a file's content."""
        directory = yield from self.directory()
        file = directory.file(name)
        content = yield from self.read(file.start, file.length)
        return content

    def store(self, name: str, content: bytes) -> Talk[None]:
        """Write a file, in place of one of that name: its blocks first, then its entry."""
        directory = yield from self.directory()
        start = _free_run(directory, len(content))
        yield from self.write(start, content)
        slots = [file.slot for file in directory.files if file.name == name] or _free_slots(directory)
        yield from self._enter(directory, slots[0], _entry(name, start, len(content)))

    def delete(self, name: str) -> Talk[None]:
        """Take a file off the disk."""
        directory = yield from self.directory()
        yield from self._enter(directory, directory.file(name).slot, bytes(16))

    def copy(self, old: str, new: str) -> Talk[None]:
        """Copy a file, in place of one that has the new name."""
        content = yield from self.load(old)
        yield from self.store(new, content)

    def rename(self, old: str, new: str) -> Talk[None]:
        """Give a file another name, which no other may have."""
        directory = yield from self.directory()
        file = directory.file(old)
        if any(other.name == new for other in directory.files):
            raise FloppyError(f"{new}: there is such a file already")
        yield from self._enter(directory, file.slot, _entry(new, file.start, file.length))

    def image(self, tell: Callable[[int], None] = lambda blocks: None) -> Talk[bytes]:
        """Return the whole medium, block by block until the drive has no more; ``tell`` hears how many there are."""
        content = bytearray()
        while True:
            try:
                content += yield from self.read(len(content) // BLOCK, BLOCK)
            except NoBlockError:
                return bytes(content)
            tell(len(content) // BLOCK)

    def read(self, block: int, count: int, modifier: int = 0) -> Talk[bytes]:
        """Return ``count`` bytes from a block on; more than 32 KiB come in pieces."""
        content = b""
        while len(content) < count:
            piece = min(count - len(content), 64 * BLOCK)
            self._command(_READ, modifier, piece, block + len(content) // BLOCK)
            content += yield from self._data_until_end(piece)
        return content

    def write(self, block: int, content: bytes, modifier: int = 0) -> Talk[None]:
        """Write bytes from a block on, in pieces; the drive fills the last block with zeros."""
        for begin in range(0, len(content), 64 * BLOCK):
            piece = content[begin : begin + 64 * BLOCK]
            self._command(_WRITE, modifier, len(piece), block + begin // BLOCK)
            for at in range(0, len(piece), 128):
                flag = yield from self._exactly(1)
                if flag != b"\x10":
                    yield from self._end(flag)
                    raise FloppyError(f"write: expected CONTINUE (10), got {flag.hex()}")
                part = piece[at : at + 128]
                self._send += _packet(b"\x01" + bytes((len(part),)) + part)
            flag = yield from self._exactly(1)
            yield from self._end(flag)

    def _enter(self, directory: Directory, slot: int, entry: bytes) -> Talk[None]:
        """Write the 128-byte record of the directory that has this entry."""
        raw = bytearray(directory.raw)
        raw[slot * 16 : slot * 16 + 16] = entry
        record = slot * 16 // 128
        yield from self.write(directory.first * 4 + record, bytes(raw[record * 128 :][:128]), _RECORDS)

    def _command(self, opcode: int, modifier: int, count: int, block: int) -> None:
        switches = _MRSP if self._mrsp else 0
        head = bytes((0x02, 0x0A, opcode, modifier, self._unit, switches, 0, 0))
        self._send += _packet(head + count.to_bytes(2, "little") + block.to_bytes(2, "little"))

    def _data_until_end(self, count: int) -> Talk[bytes]:
        content = b""
        while True:
            flag = yield from self._exactly(1)
            if flag != b"\x01":
                yield from self._end(flag)
                if len(content) != count:
                    raise FloppyError(f"read: expected {count} bytes, got {len(content)}")
                return content
            length = yield from self._exactly(1)
            content += yield from self._checked(flag + length, length[0])

    def _end(self, flag: bytes) -> Talk[None]:
        """Take the rest of an END packet; FloppyError when it says no."""
        length = yield from self._exactly(1)
        if flag + length != b"\x02\x0a":
            raise FloppyError(f"drive: expected an END packet (02 0A), got {flag.hex()} {length.hex()}")
        message = yield from self._checked(flag + length, 10)
        if message[0] != 0x40:
            raise FloppyError(f"drive: expected END (40), got {message[0]:02X}")
        if message[1] > 1:
            why = CODES.get(message[1], "unknown code")
            kind = NoBlockError if message[1] == NO_BLOCK else FloppyError
            raise kind(f"drive: {why} ({message[1]:02X}) after {int.from_bytes(message[6:8], 'little')} bytes")

    def _checked(self, head: bytes, length: int) -> Talk[bytes]:
        """Take the rest of a packet and hold its checksum against the bytes."""
        message = yield from self._exactly(length)
        check = yield from self._exactly(2)
        if ones_sum(head + message) != int.from_bytes(check, "little"):
            raise FloppyError(f"packet {head.hex()}: wrong checksum {check.hex()}")
        return message

    def _exactly(self, count: int, plain: bool = False) -> Talk[bytes]:
        """Send what is to be sent and wait for so many bytes; under MRSP each is asked for by a CONTINUE."""
        while len(self._came) < count:
            sent, self._send = self._send, b""
            came = yield sent
            self._came += came
            if self._mrsp and not plain:
                self._send += b"\x10" * len(came)
        taken = bytes(self._came[:count])
        del self._came[:count]
        return taken


def _packet(body: bytes) -> bytes:
    return body + ones_sum(body).to_bytes(2, "little")


def _file(slot: int, entry: bytes) -> File:
    name = entry[:10].decode("ascii", "replace").strip()
    return File(slot, name, int.from_bytes(entry[10:12], "little"), int.from_bytes(entry[12:16], "little"))


def _entry(name: str, start: int, length: int) -> bytes:
    return name.encode("ascii").ljust(10)[:10] + start.to_bytes(2, "little") + length.to_bytes(4, "little")


def _free_run(directory: Directory, length: int) -> int:
    """Return the first block of a free run; 0 for nothing. FloppyError when the disk is full."""
    taken = {file.start + at for file in directory.files for at in range(file.blocks)}
    need, run = (length + BLOCK - 1) // BLOCK, 0
    for block in directory.data if need else ():
        run = 0 if block in taken else run + 1
        if run == need:
            return block - need + 1
    if need:
        raise FloppyError(f"the disk is full: no {need} free blocks in a row")
    return 0


def _free_slots(directory: Directory) -> list[int]:
    taken = {file.slot for file in directory.files}
    free = [slot for slot in range(len(directory.raw) // 16) if slot not in taken]
    if not free:
        raise FloppyError("the directory is full")
    return free
