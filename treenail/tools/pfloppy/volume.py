"""A folder as a disk: an image in memory, files written when the controller writes its directory.

The folder is looked at anew whenever the first directory block is read, and at no other time: so the controller's idea
of the directory and this one never differ. What it writes to free blocks is kept in memory until a directory entry
names it; the blocks of files that are listed cannot be written. Changing a file therefore means: write other blocks,
then the entry. That is the moment at which the file changes on the host, whole.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from treenail.tools.pfloppy.changes import Changes, changes
from treenail.tools.pfloppy.disk_errors import DamageError, DiskError, ProtectedError
from treenail.tools.pfloppy.folder import Folder, Identity
from treenail.tools.pfloppy.layout import BLOCK, BLOCKS, NAME, Entry, Layout, LayoutError, PlainLayout

RECORD = 128
"""Smallest piece that can be written."""
BOOT_FILE = "BOOT.BLK"
"""If there is one, its first 512 bytes are the boot block."""


@dataclass
class Item:
    """A file that is listed."""

    slot: int
    entry: Entry
    host_name: str
    """Its name in the folder, which may be in small letters."""
    identity: Identity


class Volume:
    """One unit of the drive; ``say`` gets lines for the person at the host."""

    size = BLOCKS * BLOCK

    def __init__(
        self,
        folder: Folder,
        system: str = "VAL.SYS",
        read_only: bool = False,
        say: Callable[[str], None] = lambda line: None,
        layout: Layout | None = None,
    ) -> None:
        self._folder, self._system, self._read_only, self._say = folder, system, read_only, say
        self._layout: Layout = PlainLayout() if layout is None else layout
        self._image = bytearray(self.size)
        self._items: dict[str, Item] = {}
        self._staged: set[int] = set()  # records of free blocks that the controller has written
        self._said: set[str] = set()
        self._directory_read = False
        self._refresh()

    def read(self, offset: int, count: int) -> bytes:
        """Return bytes; looks at the folder first if the first directory block is among them."""
        self._check(offset, count)
        first = self._layout.directory.start * BLOCK
        if offset <= first < offset + count:
            self._refresh()
            self._directory_read = True
        return bytes(self._image[offset : offset + count])

    def boot(self) -> bytes:
        """Look at the folder and return the boot block; a controller that boots knows no directory yet."""
        self._refresh()
        self._directory_read = False
        return bytes(self._image[:BLOCK])

    def read_back(self, offset: int, count: int) -> bytes:
        """Return bytes without looking at the folder."""
        self._check(offset, count)
        return bytes(self._image[offset : offset + count])

    def write(self, offset: int, data: bytes) -> None:
        """Keep data blocks in memory; make a directory's changes in the folder. Raises DiskError."""
        self._check(offset, len(data))
        if offset % RECORD or len(data) % RECORD:
            raise ValueError(f"write: expected a multiple of {RECORD}, got offset {offset}, {len(data)} bytes")
        try:
            self._write(offset, data)
        except DiskError as error:
            self._say(f"{self._folder.path}: refused: {error}")
            raise

    def _write(self, offset: int, data: bytes) -> None:
        if self._read_only:
            raise ProtectedError("the drive was started with --read-only")
        begin, end = self._layout.directory.start * BLOCK, self._layout.directory.stop * BLOCK
        if offset < begin and data:
            raise ProtectedError("boot and home block are made from the folder")
        if offset >= end:
            self._stage(offset, data)
            return
        if offset + len(data) > end:
            raise ProtectedError("directory and files cannot be written at once")
        directory = bytearray(self._image[begin:end])
        directory[offset - begin : offset - begin + len(data)] = data
        self._commit(bytes(directory))

    def _stage(self, offset: int, data: bytes) -> None:
        records = range(offset // RECORD, (offset + len(data)) // RECORD)
        listed = self._listed_records()
        for record in records:
            if record in listed:
                raise ProtectedError(
                    f"block {record * RECORD // BLOCK} belongs to {listed[record]}; write to free ones"
                )
        self._image[offset : offset + len(data)] = data
        self._staged.update(records)

    def _commit(self, directory: bytes) -> None:
        """Make the folder what a new directory says."""
        if not self._directory_read:
            raise ProtectedError("the directory must be read before it is written: it may have changed")
        try:
            wanted = self._layout.decode(directory)
        except LayoutError as error:
            raise DamageError(f"directory: {error}") from error
        old = {name: item.entry for name, item in self._items.items()}
        todo = changes(old, {entry.name: entry for entry in wanted.values()})
        self._check_changes(todo)
        try:
            self._make(todo)
            for slot, entry in wanted.items():
                self._items[entry.name].slot = slot
        finally:
            self._write_directory()

    def _check_changes(self, todo: Changes) -> None:
        """Refuse before anything is done what would publish unwritten blocks or hit files that are not ours."""
        for entry in todo.saved:
            own = _records(self._items[entry.name].entry) if entry.name in self._items else ()
            if any(record not in self._staged and record not in own for record in _records(entry)):
                raise DamageError(f"{entry.name}: not all of its blocks have been written")
        touched = [*todo.deleted, *todo.renamed, *(entry.name for entry in todo.saved if entry.name in self._items)]
        for item in (self._items[name] for name in touched):
            if self._folder.identity(item.host_name) != item.identity:
                raise ProtectedError(f"{item.host_name}: has changed on the host; read the directory again")
        strangers = {name.upper() for name in self._folder.names()}
        strangers -= {item.host_name.upper() for item in self._items.values()}
        created = {entry.name for entry in todo.saved} - self._items.keys()
        for name in sorted(strangers & (created | {new.name for new in todo.renamed.values()})):
            raise ProtectedError(f"{name}: the folder has something of that name that is not on the disk")

    def _make(self, todo: Changes) -> None:
        """Save, then rename, then delete; what was done before a failure stays done and stays listed."""
        for entry in todo.saved:
            begin = entry.start * BLOCK
            content = bytes(self._image[begin : begin + entry.length])
            item = self._items.get(entry.name)
            host_name = entry.name if item is None else item.host_name
            identity = self._folder.save(host_name, content)
            slot = self._free_slot() if item is None else item.slot
            self._items[entry.name] = Item(slot, entry, host_name, identity)
            self._staged.difference_update(_records(entry))
            self._say(f"{self._folder.path / host_name}: written, {entry.length} bytes")
        for old, entry in todo.renamed.items():
            item = self._items.pop(old)
            identity = self._folder.rename(item.host_name, entry.name)
            self._items[entry.name] = Item(item.slot, entry, entry.name, identity)
            self._say(f"{self._folder.path / item.host_name}: now {entry.name}")
        for name in todo.deleted:
            self._folder.delete(self._items[name].host_name)
            self._say(f"{self._folder.path / self._items.pop(name).host_name}: deleted")

    def _refresh(self) -> None:
        """Take over what has changed in the folder."""
        complaints: list[str] = []
        files = self._look(complaints)
        for name, item in list(self._items.items()):
            host_name, identity = files.get(name, ("", None))
            if (host_name, identity) != (item.host_name, item.identity):
                del self._items[name]
        for name, (host_name, _) in files.items():
            if name not in self._items:
                try:
                    self._add(name, host_name)
                except DamageError as error:
                    complaints.append(str(error))
        self._write_directory()
        for complaint in complaints:
            if complaint not in self._said:
                self._say(f"{self._folder.path}: not on the disk: {complaint}")
        self._said = set(complaints)

    def _look(self, complaints: list[str]) -> dict[str, tuple[str, Identity]]:
        """Return the folder's files that can be on the disk, by name there."""
        files: dict[str, tuple[str, Identity]] = {}
        for host_name in self._folder.names():  # capital letters sort first
            name, identity = host_name.upper(), self._folder.identity(host_name)
            if identity is None:
                complaints.append(f"{host_name}: no plain file")
            elif not (host_name.isascii() and NAME.fullmatch(name)):
                complaints.append(f"{host_name}: no name for the disk")
            elif name in files:
                complaints.append(f"{host_name}: {files[name][0]} has that name already")
            else:
                files[name] = (host_name, identity)
        return files

    def _add(self, name: str, host_name: str) -> None:
        """List a file of the folder. Raises DamageError when it does not fit."""
        if len(self._items) == self._layout.slots:
            raise DamageError(f"{host_name}: the directory is full, {self._layout.slots} files")
        identity, content = self._folder.load(host_name, len(self._layout.data) * BLOCK)
        entry = self._place(name, len(content))
        self._items[name] = Item(self._free_slot(), entry, host_name, identity)
        self._put(entry, content)

    def _place(self, name: str, length: int) -> Entry:
        """Return an entry in free blocks; all files are moved together if that is what it takes."""
        need = -(-length // BLOCK)
        if not need:
            return Entry(name, 0, 0)
        for again in (False, True):
            taken = {block for item in self._items.values() for block in item.entry.blocks}
            run = 0
            for block in self._layout.data:
                run = 0 if block in taken else run + 1
                if run == need:
                    return Entry(name, block - need + 1, length)
            if again or len(self._layout.data) - len(taken) < need:
                break
            self._compact()
        raise DamageError(f"{name}: the disk is full, {length} bytes do not fit")

    def _compact(self) -> None:
        """Move all files to the front. Only while the directory is read, so the controller learns of it."""
        contents = {name: self._content(item.entry) for name, item in self._items.items()}
        free = self._layout.data.start
        for name, item in self._items.items():
            if item.entry.length:
                item.entry = item.entry._replace(start=free)
                free = item.entry.blocks.stop
                self._put(item.entry, contents[name])

    def _content(self, entry: Entry) -> bytes:
        return bytes(self._image[entry.start * BLOCK : entry.start * BLOCK + entry.length])

    def _put(self, entry: Entry, content: bytes) -> None:
        filled = content.ljust(len(entry.blocks) * BLOCK, b"\0")
        self._image[entry.start * BLOCK : entry.start * BLOCK + len(filled)] = filled
        self._staged.difference_update(_records(entry))

    def _write_directory(self) -> None:
        """Bring boot, home and directory blocks up to date."""
        begin = self._layout.directory.start * BLOCK
        encoded = self._layout.encode({item.slot: item.entry for item in self._items.values()})
        self._image[begin : begin + len(encoded)] = encoded
        self._image[BLOCK : 2 * BLOCK] = self._layout.home()
        own, system = self._items.get(BOOT_FILE), self._items.get(self._system)
        boot = self._layout.boot(None if system is None else system.entry)
        self._image[:BLOCK] = boot if own is None else self._content(own.entry)[:BLOCK].ljust(BLOCK, b"\0")

    def _free_slot(self) -> int:
        taken = {item.slot for item in self._items.values()}
        return next(slot for slot in range(self._layout.slots + 1) if slot not in taken)

    def _listed_records(self) -> dict[int, str]:
        return {record: item.entry.name for item in self._items.values() for record in _records(item.entry)}

    def _check(self, offset: int, count: int) -> None:
        if offset < 0 or count < 0 or offset + count > self.size:
            raise ValueError(f"disk: expected {self.size} bytes, got offset {offset}, count {count}")


def _records(entry: Entry) -> range:
    """Return the records of the blocks that an entry fills."""
    per_block = BLOCK // RECORD
    return range(entry.blocks.start * per_block, entry.blocks.stop * per_block)
