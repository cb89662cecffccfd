"""The image of a disk: copied off a drive, served in its place, and never half written."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import pytest

from services.robot_link.emulator.floppy import FloppyClient, FloppyError, NoBlockError, Talk
from tests.unit.treenail.drives import carry_out
from treenail.tools.pfloppy.disk_errors import DiskError, ProtectedError
from treenail.tools.pfloppy.folder import Folder, FolderError
from treenail.tools.pfloppy.image import Image
from treenail.tools.pfloppy.layout import BLOCK
from treenail.tools.pfloppy.protocols import Disk
from treenail.tools.pfloppy.tu58_drive import Tu58Drive
from treenail.tools.pfloppy.volume import Volume

T = TypeVar("T")


def talk(disk: Disk, operation: Talk[T]) -> T:
    """Carry an operation of a controller out that speaks to a drive with this disk."""
    return carry_out(Tu58Drive([disk]), operation)


def image_of(path: Path, content: bytes, **options: bool) -> tuple[Image, list[str]]:
    path.mkdir(exist_ok=True)
    (path / "disk.img").write_bytes(content)
    said: list[str] = []
    return Image(Folder(path), "disk.img", say=said.append, **options), said


CONTENT = bytes(n // BLOCK for n in range(6 * BLOCK))


@pytest.mark.parametrize("mrsp", [False, True])
def test_a_disk_is_copied_and_the_controller_boots_from_the_copy(tmp_path: Path, mrsp: bool) -> None:
    files = tmp_path / "files"
    files.mkdir()
    (files / "VAL.SYS").write_bytes(b"TREENAIL TEST SYSTEM\r\nrest")
    (files / "WELD.V2").write_bytes(bytes(range(256)) * 9)
    original, client, told = Volume(Folder(files)), FloppyClient(mrsp=mrsp), list[int]()
    content = talk(original, client.image(told.append))
    assert len(content) == original.size
    assert told == list(range(1, original.size // BLOCK + 1))
    copy, said = image_of(tmp_path / "copies", content)
    assert talk(copy, client.boot()) == "TREENAIL TEST SYSTEM"
    assert talk(copy, client.load("WELD.V2")) == bytes(range(256)) * 9
    talk(copy, client.store("NEW.V2", b"10 MOVE A\r\n"))
    assert talk(copy, client.load("NEW.V2")) == b"10 MOVE A\r\n"
    assert talk(copy, client.image()) == (tmp_path / "copies" / "disk.img").read_bytes() != content
    assert said[0].endswith("disk.img: written, 512 bytes from block 10"), said
    assert sorted(path.name for path in files.iterdir()) == ["VAL.SYS", "WELD.V2"], "the original is untouched"


def test_a_disk_that_is_no_treenail_s_is_served_as_it_is(tmp_path: Path) -> None:
    disk, _ = image_of(tmp_path, CONTENT)
    client = FloppyClient()
    assert talk(disk, client.image()) == CONTENT
    assert talk(disk, client.read(2, 700)) == CONTENT[2 * BLOCK : 2 * BLOCK + 700]
    talk(disk, client.write(5, b"x" * BLOCK))
    assert (tmp_path / "disk.img").read_bytes() == CONTENT[: 5 * BLOCK] + b"x" * BLOCK
    with pytest.raises(NoBlockError, match="no such block"):
        talk(disk, client.read(6, 1))


@pytest.mark.parametrize("content", [b"", b"x", bytes(BLOCK + 1)])
def test_what_is_no_image_is_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(FolderError, match=r"expected an image of whole blocks of 512 bytes, got \d+ bytes"):
        image_of(tmp_path, content)


def test_read_only_is_write_protected(tmp_path: Path) -> None:
    disk, said = image_of(tmp_path, CONTENT, read_only=True)
    with pytest.raises(FloppyError, match="write protected"):
        talk(disk, FloppyClient().write(0, b"x" * BLOCK))
    assert (tmp_path / "disk.img").read_bytes() == CONTENT
    assert "refused: the drive was started with --read-only" in said[0]


def test_what_changed_on_the_host_is_not_written_over(tmp_path: Path) -> None:
    disk, said = image_of(tmp_path, CONTENT)
    other = bytes(reversed(CONTENT))
    (tmp_path / "new").write_bytes(other)
    (tmp_path / "new").rename(tmp_path / "disk.img")
    assert disk.read(0, BLOCK) == CONTENT[:BLOCK], "one moment, until the controller boots"
    with pytest.raises(ProtectedError, match="boot again"):
        disk.write(0, b"x" * BLOCK)
    assert (tmp_path / "disk.img").read_bytes() == other
    assert disk.boot() == other[:BLOCK]
    disk.write(0, b"x" * BLOCK)
    assert (tmp_path / "disk.img").read_bytes() == b"x" * BLOCK + other[BLOCK:]
    assert len(said) == 2
    (tmp_path / "disk.img").write_bytes(CONTENT + bytes(BLOCK))
    with pytest.raises(DiskError, match="expected the 3072 bytes that it had, got 3584"):
        disk.boot()


def test_a_full_host_leaves_the_old_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk, _ = image_of(tmp_path, CONTENT)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(DiskError, match="No space left"):
        disk.write(0, b"x" * BLOCK)
    monkeypatch.undo()
    assert (tmp_path / "disk.img").read_bytes() == disk.read(0, disk.size) == CONTENT
    assert [path.name for path in tmp_path.iterdir()] == ["disk.img"]


def test_a_disk_has_its_grid_and_its_end(tmp_path: Path) -> None:
    disk, _ = image_of(tmp_path, CONTENT)
    for offset, data in ((64, b"x" * 128), (0, b"x")):
        with pytest.raises(ValueError, match="multiple of 128"):
            disk.write(offset, data)
    with pytest.raises(ValueError, match="expected 3072 bytes"):
        disk.write(disk.size, b"x" * 128)
    with pytest.raises(ValueError, match="expected 3072 bytes"):
        disk.read(0, disk.size + 1)
