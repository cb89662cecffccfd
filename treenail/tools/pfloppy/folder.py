"""The host's side of a disk: plain files of one folder, read and replaced whole.

All is done relative to the open folder, so that nothing outside it is ever touched. A file is written beside its place,
flushed to the disk and then renamed: a process that is killed at any moment leaves the old file or the new one.
"""

from __future__ import annotations

import fcntl
import os
import stat
from pathlib import Path
from typing import NamedTuple

from services.wire.errors import TreenailError
from treenail.tools.pfloppy.disk_errors import DamageError, MissingError

_TEMPORARY = ".pfloppy-temporary"
_FLAGS = os.O_CLOEXEC | os.O_NOFOLLOW


class FolderError(TreenailError):
    """A folder that cannot be used."""


class Identity(NamedTuple):
    """Tells whether a file is still the one that was looked at."""

    inode: int
    length: int
    modified_ns: int
    changed_ns: int


class Folder:
    """One folder, held open and locked against a second pfloppy."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._fd = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        except OSError as error:
            raise FolderError(f"{path}: expected a folder, got: {error.strerror}") from error
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(self._fd)
            raise FolderError(f"{path}: served by another pfloppy") from error
        self._discard()  # what one that was killed has left

    def close(self) -> None:
        """Let go of the folder."""
        os.close(self._fd)

    def names(self) -> list[str]:
        """Return the names of all there is but hidden ones, sorted. Raises MissingError."""
        try:
            if os.fstat(self._fd).st_nlink == 0:
                raise MissingError(f"{self.path}: the folder is gone")
            return sorted(name for name in os.listdir(self._fd) if not name.startswith("."))
        except OSError as error:
            raise MissingError(f"{self.path}: cannot be listed: {error.strerror}") from error

    def identity(self, name: str) -> Identity | None:
        """Return which file this is, or None when it is not there or no plain file."""
        try:
            return _identity(os.stat(name, dir_fd=self._fd, follow_symlinks=False))
        except OSError:
            return None

    def load(self, name: str, limit: int) -> tuple[Identity, bytes]:
        """Return a file's content, of at most ``limit`` bytes, and which file it was. Raises DamageError."""
        try:
            fd = os.open(name, os.O_RDONLY | os.O_NONBLOCK | _FLAGS, dir_fd=self._fd)
        except OSError as error:
            raise DamageError(f"{name}: cannot be read: {error.strerror}") from error
        with os.fdopen(fd, "rb") as file:
            try:
                before = _identity(os.fstat(fd))
                content = file.read(limit + 1)
                after = _identity(os.fstat(fd))
            except OSError as error:
                raise DamageError(f"{name}: cannot be read: {error.strerror}") from error
        if before is None or len(content) > limit:
            raise DamageError(f"{name}: expected a plain file of at most {limit} bytes")
        if before != after or len(content) != before.length:
            raise DamageError(f"{name}: is being written at this moment")
        return before, content

    def save(self, name: str, content: bytes) -> Identity:
        """Replace or make a file, whole or not at all, and wait for the disk. Raises DamageError."""
        try:
            self._prepare(name, content)
            os.rename(_TEMPORARY, name, src_dir_fd=self._fd, dst_dir_fd=self._fd)
            os.fsync(self._fd)
        except OSError as error:
            self._discard()
            raise DamageError(f"{name}: cannot be written: {error.strerror}") from error
        return self._known(name)

    def rename(self, old: str, new: str) -> Identity:
        """Give a file another name. Raises DamageError."""
        try:
            os.rename(old, new, src_dir_fd=self._fd, dst_dir_fd=self._fd)
            os.fsync(self._fd)
        except OSError as error:
            raise DamageError(f"{old}: cannot be renamed {new}: {error.strerror}") from error
        return self._known(new)

    def delete(self, name: str) -> None:
        """Delete a file. Raises DamageError."""
        try:
            os.unlink(name, dir_fd=self._fd)
            os.fsync(self._fd)
        except OSError as error:
            raise DamageError(f"{name}: cannot be deleted: {error.strerror}") from error

    def _prepare(self, name: str, content: bytes) -> None:
        """Write the new content beside the old, with the old one's permissions. Raises OSError."""
        self._discard()
        fd = os.open(_TEMPORARY, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _FLAGS, 0o666, dir_fd=self._fd)
        with os.fdopen(fd, "wb") as file:
            if self.identity(name) is not None:
                mode = os.stat(name, dir_fd=self._fd, follow_symlinks=False).st_mode
                os.fchmod(fd, stat.S_IMODE(mode))
            file.write(content)
            file.flush()
            os.fsync(fd)

    def _discard(self) -> None:
        try:
            os.unlink(_TEMPORARY, dir_fd=self._fd)
        except OSError:  # it is not there, which is right, or cannot be made either, which will be said
            return

    def _known(self, name: str) -> Identity:
        identity = self.identity(name)
        if identity is None:
            raise DamageError(f"{name}: somebody took it away at this moment")
        return identity


def _identity(status: os.stat_result) -> Identity | None:
    if not stat.S_ISREG(status.st_mode):
        return None
    return Identity(status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns)
