"""What a floppy protocol and a disk have to be, and how protocols are found by name.

Other packages register a class under the entry point group ``treenail.floppies``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from services.rules.plugins import installed
from services.wire.errors import TreenailError
from treenail.tools.pfloppy.tu58_drive import Tu58Drive

GROUP = "treenail.floppies"


class ProtocolError(TreenailError):
    """A protocol that is not there or cannot be loaded."""


class Disk(Protocol):
    """One unit: ``size`` bytes that are read and written whole transfers at a time."""

    @property
    def size(self) -> int:
        """Bytes in all, a multiple of 512."""

    def read(self, offset: int, count: int) -> bytes:
        """Return bytes of one moment. Raises DiskError (``disk_errors.py``); ValueError outside the disk."""

    def boot(self) -> bytes:
        """Return the first 512 bytes for a controller that starts anew. Raises DiskError."""

    def read_back(self, offset: int, count: int) -> bytes:
        """Return what the last ``write`` left there, for comparing. Raises DiskError."""

    def write(self, offset: int, data: bytes) -> None:
        """Write all of ``data`` or nothing; it has reached the host's disk on return if it made files.

        Raises DiskError with nothing damaged; ValueError outside the disk or off the 128-byte grid.
        """


class FloppyProtocol(Protocol):
    """A drive as a pure machine: bytes in, bytes out; no port, clock or thread. Called with the units' disks.

    Whatever comes in, it must not raise; it answers errors as its protocol does.
    """

    summary: str
    """One line for people: what this is and what it is not."""

    def receive(self, data: bytes) -> None:
        """Take bytes from the controller."""

    def transmit(self) -> bytes:
        """Return the next bytes to send, at most a packet; nothing while there are none or the controller holds."""

    def silence(self) -> None:
        """Take note that nothing has come for a while (1 s)."""


class MakesProtocol(Protocol):
    """The class of a protocol."""

    summary: str

    def __call__(self, disks: Sequence[Disk]) -> FloppyProtocol:
        """Return a drive that has just been switched on."""


BUILT_IN: dict[str, MakesProtocol] = {"tu58": Tu58Drive}


def names() -> list[str]:
    """Return the names of all protocols."""
    return sorted({*BUILT_IN, *installed(GROUP)})


def find(name: str) -> MakesProtocol:
    """Return a protocol by name. Raises ProtocolError."""
    if name in BUILT_IN:
        return BUILT_IN[name]
    points = installed(GROUP)
    if name not in points:
        raise ProtocolError(f"--protocol: expected one of {', '.join(names())}, got {name!r}")
    try:
        made: MakesProtocol = points[name].load()
    except Exception as error:  # an import runs whatever code the package has
        why = " ".join(f"{type(error).__name__}: {error}".split())
        raise ProtocolError(f"protocol {name!r}: {points[name].value} cannot be loaded: {why}") from error
    return made
