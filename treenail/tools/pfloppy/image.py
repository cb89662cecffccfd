"""An image of a whole disk, block after block in one file, as a disk: whatever its system and its directory are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from treenail.tools.pfloppy.disk_errors import ProtectedError
from treenail.tools.pfloppy.folder import Folder, FolderError
from treenail.tools.pfloppy.layout import BLOCK
from treenail.tools.pfloppy.volume import RECORD

MOST_BLOCKS = 2**16
"""More have no number in the stand-in protocol."""


class Image:
    """One unit of the drive; what is written is in the file, whole, when ``write`` returns."""

    def __init__(
        self, folder: Folder, name: str, read_only: bool = False, say: Callable[[str], None] = lambda line: None
    ) -> None:
        """Take the file ``name`` of a folder. Raises FolderError for one that is no image, DiskError."""
        self._folder, self._name, self._read_only, self._say = folder, name, read_only, say
        self._identity, self._content = folder.load(name, MOST_BLOCKS * BLOCK)
        if not self._content or len(self._content) % BLOCK:
            got = f"{len(self._content)} bytes"
            raise FolderError(f"{self.path}: expected an image of whole blocks of {BLOCK} bytes, got {got}")

    @property
    def path(self) -> Path:
        """The file."""
        return self._folder.path / self._name

    @property
    def size(self) -> int:
        """Bytes in all."""
        return len(self._content)

    def read(self, offset: int, count: int) -> bytes:
        """Return bytes."""
        self._check(offset, count)
        return self._content[offset : offset + count]

    read_back = read

    def boot(self) -> bytes:
        """Look at the file anew, for a controller that starts anew, and return the boot block. Raises DiskError."""
        identity, content = self._folder.load(self._name, MOST_BLOCKS * BLOCK)
        if len(content) != self.size:
            raise ProtectedError(f"{self.path}: expected the {self.size} bytes that it had, got {len(content)}")
        self._identity, self._content = identity, content
        return content[:BLOCK]

    def write(self, offset: int, data: bytes) -> None:
        """Replace the file by one with these bytes in it: killed at any moment, it is the old one or the new one."""
        self._check(offset, len(data))
        if offset % RECORD or len(data) % RECORD:
            raise ValueError(f"write: expected a multiple of {RECORD}, got offset {offset}, {len(data)} bytes")
        if self._read_only:
            raise self._refused("the drive was started with --read-only")
        if self._folder.identity(self._name) != self._identity:
            raise self._refused("it has changed on the host; boot again")
        content = self._content[:offset] + data + self._content[offset + len(data) :]
        self._identity = self._folder.save(self._name, content)
        self._content = content
        self._say(f"{self.path}: written, {len(data)} bytes from block {offset // BLOCK}")

    def _refused(self, why: str) -> ProtectedError:
        self._say(f"{self.path}: refused: {why}")
        return ProtectedError(why)

    def _check(self, offset: int, count: int) -> None:
        if offset < 0 or count < 0 or offset + count > self.size:
            raise ValueError(f"disk: expected {self.size} bytes, got offset {offset}, count {count}")
