"""How files lie on the disk: a layout of our own, since VAL II's is not publicly known. Pure.

All numbers are little-endian. A block has 512 bytes, a disk 512 blocks (256 KiB):

    block 0       boot block: BOOT.BLK's first 512 bytes, or one made by pfloppy: "BOOT", name (10),
                  start (2), length (4)
    block 1       home block: "TREENAIL", version 1 (2), first directory block (2), directory blocks (2),
                  first data block (2), blocks in all (2); the rest is 0
    blocks 2-3    directory: 64 entries of 16 bytes: name (10), start block (2), length in bytes (4);
                  a free entry is all zeros
    blocks 4-511  data: each file is one run of blocks, its last block filled with zeros

A name has up to 6 capital letters and digits, the first a letter, and may have a point and up to 3 more; it is filled
with spaces. An empty file has start 0.
"""

from __future__ import annotations

import re
import struct
from typing import NamedTuple, Protocol

BLOCK = 512
BLOCKS = 512
NAME = re.compile(r"[A-Z][A-Z0-9]{0,5}(\.[A-Z0-9]{1,3})?")
NAME_RULE = "up to 6 letters and digits, first a letter, then perhaps a point and up to 3 more"
_ENTRY = struct.Struct("<10sHI")
_HOME = struct.Struct("<8sHHHHH")
_BOOT = struct.Struct("<4s10sHI")


class LayoutError(ValueError):
    """A directory that makes no sense: entry, expected, got."""


class Entry(NamedTuple):
    """One file in the directory."""

    name: str
    start: int
    """First block; 0 for an empty file."""
    length: int
    """Bytes."""

    @property
    def blocks(self) -> range:
        """The blocks that it fills."""
        return range(self.start, self.start + -(-self.length // BLOCK))


class Layout(Protocol):
    """A way to lay files out on a disk, should VAL II's own become known."""

    directory: range
    """Blocks of the directory."""
    data: range
    """Blocks of the files."""
    slots: int
    """Most files."""

    def home(self) -> bytes:
        """Return the home block, or zeros where there is none."""

    def boot(self, system: Entry | None) -> bytes:
        """Return a boot block for a system file; zeros for None."""

    def encode(self, entries: dict[int, Entry]) -> bytes:
        """Return the directory's bytes; entries by slot."""

    def decode(self, directory: bytes) -> dict[int, Entry]:
        """Return the entries by slot. LayoutError when names, places or lengths cannot be."""


class PlainLayout:
    """The layout above."""

    directory = range(2, 4)
    data = range(4, BLOCKS)
    slots = len(directory) * BLOCK // _ENTRY.size

    def home(self) -> bytes:
        """Return the home block."""
        first, many = self.directory.start, len(self.directory)
        return _HOME.pack(b"TREENAIL", 1, first, many, self.data.start, BLOCKS).ljust(BLOCK, b"\0")

    def boot(self, system: Entry | None) -> bytes:
        """Return a boot block that names a system file; zeros for None."""
        if system is None:
            return bytes(BLOCK)
        return _BOOT.pack(b"BOOT", _padded(system.name), system.start, system.length).ljust(BLOCK, b"\0")

    def encode(self, entries: dict[int, Entry]) -> bytes:
        """Return the directory's bytes; entries by slot, 0 to 63."""
        directory = bytearray(len(self.directory) * BLOCK)
        for slot, entry in entries.items():
            _ENTRY.pack_into(directory, slot * _ENTRY.size, _padded(entry.name), entry.start, entry.length)
        return bytes(directory)

    def decode(self, directory: bytes) -> dict[int, Entry]:
        """Return the entries by slot. LayoutError when names, places or lengths cannot be."""
        entries: dict[int, Entry] = {}
        taken: dict[int, str] = {}
        names: set[str] = set()
        for slot, (raw, start, length) in enumerate(_ENTRY.iter_unpack(directory)):
            if not any(raw) and start == length == 0:
                continue
            entry = Entry(_name(slot, raw), start, length)
            if entry.name in names:
                raise LayoutError(f"entry {slot}: expected a name of its own, got {entry.name} again")
            if length and not (start in self.data and entry.blocks[-1] in self.data):
                raise LayoutError(f"{entry.name}: expected blocks {self.data.start} to {self.data[-1]}, got {entry}")
            for block in entry.blocks:
                if block in taken:
                    raise LayoutError(f"{entry.name}: expected blocks of its own, got block {block} of {taken[block]}")
                taken[block] = entry.name
            names.add(entry.name)
            entries[slot] = entry
        return entries


def _padded(name: str) -> bytes:
    return name.encode("ascii").ljust(10)


def _name(slot: int, raw: bytes) -> str:
    name = raw.decode("latin-1").rstrip(" ")
    if not NAME.fullmatch(name):
        raise LayoutError(f"entry {slot}: name: expected {NAME_RULE}, got {name!r}")
    return name
