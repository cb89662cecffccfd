"""A folder as a disk, driven by the controller's side: files survive everything, also being killed at any point."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.robot_link.emulator.floppy import FloppyClient, FloppyError, Talk
from tests.unit.treenail.drives import carry_out, said
from treenail.tools.pfloppy.disk_errors import DiskError
from treenail.tools.pfloppy.folder import Folder, FolderError
from treenail.tools.pfloppy.layout import Entry, PlainLayout
from treenail.tools.pfloppy.tu58_drive import Tu58Drive
from treenail.tools.pfloppy.volume import Volume

T = TypeVar("T")
DIRECTORY = range(2 * 512, 4 * 512)
ENTRIES = st.builds(
    lambda name, start, length: name.ljust(10) + start.to_bytes(2, "little") + length.to_bytes(4, "little"),
    st.sampled_from([b"A", b"B.C", b"../X", b"FOREIGN", b"\0", b"C"]),
    st.integers(0, 12),
    st.integers(0, 1600),
)
"""Entries of a directory, good and bad."""


class Bench:
    """Controller, drive and folder in one process."""

    def __init__(self, path: Path, mrsp: bool = False, **options: Any) -> None:
        self.path, self.said = path, []  # type: ignore[var-annotated]
        self.folder = Folder(path)
        self.volume = Volume(self.folder, say=self.said.append, **options)
        self.drive = Tu58Drive([self.volume])
        self.client = FloppyClient(mrsp=mrsp)

    def do(self, operation: Talk[T]) -> T:
        """Carry an operation of the controller out."""
        return carry_out(self.drive, operation)

    def names(self) -> dict[str, int]:
        """Return what the controller sees: lengths by name."""
        return {file.name: file.length for file in self.do(self.client.directory()).files}

    def files(self) -> dict[str, bytes]:
        """Return what the host sees."""
        return {path.name: path.read_bytes() for path in self.path.iterdir()}


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path)
    yield made
    made.folder.close()


@pytest.mark.parametrize("mrsp", [False, True])
def test_all_that_a_controller_does_with_files(tmp_path: Path, mrsp: bool) -> None:
    (tmp_path / "VAL.SYS").write_bytes(b"TREENAIL TEST SYSTEM\r\nrest")
    bench = Bench(tmp_path, mrsp)
    big = bytes(range(256)) * 300
    assert bench.do(bench.client.boot()) == "TREENAIL TEST SYSTEM"
    bench.do(bench.client.wake())
    for name, content in {"A": b"", "B.V2": b"x", "C": bytes(512), "D": bytes(513), "LONG12.345": big}.items():
        bench.do(bench.client.store(name, content))
        assert (tmp_path / name).read_bytes() == content
        assert bench.do(bench.client.load(name)) == content
    bench.do(bench.client.copy("LONG12.345", "E"))
    bench.do(bench.client.copy("B.V2", "D"))
    bench.do(bench.client.rename("C", "F"))
    bench.do(bench.client.delete("A"))
    expected = {"VAL.SYS": 26, "B.V2": 1, "D": 1, "F": 512, "LONG12.345": 76800, "E": 76800}
    assert bench.names() == expected
    assert {name: len(content) for name, content in bench.files().items()} == expected
    assert bench.files()["E"] == big
    assert bench.files()["D"] == b"x"


def test_what_people_do_in_the_folder_is_seen_at_the_next_directory(bench: Bench) -> None:
    (bench.path / "small.v2").write_bytes(b"one")
    (bench.path / "GONE").write_bytes(b"two")
    assert bench.names() == {"SMALL.V2": 3, "GONE": 3}
    (bench.path / "GONE").unlink()
    (bench.path / "small.v2").write_bytes(b"other")
    assert bench.do(bench.client.load("SMALL.V2")) == b"other"
    assert bench.names() == {"SMALL.V2": 5}
    bench.do(bench.client.store("SMALL.V2", b"from the controller"))
    assert bench.files() == {"small.v2": b"from the controller"}


def test_between_two_directories_the_controller_sees_one_moment(bench: Bench) -> None:
    (bench.path / "A").write_bytes(b"before" * 500)
    before = bench.do(bench.client.directory()).file("A")
    (bench.path / "A").write_bytes(b"behind" * 500)
    assert bench.do(bench.client.read(before.start, 3000)) == b"before" * 500
    assert bench.do(bench.client.load("A")) == b"behind" * 500


def test_foreign_things_are_not_shown_not_followed_and_not_touched(bench: Bench, tmp_path: Path) -> None:
    secret = tmp_path.parent / f"{tmp_path.name}-secret"
    secret.write_bytes(b"secret")
    (bench.path / "LINK").symlink_to(secret)
    (bench.path / "SUB").mkdir()
    (bench.path / "name too long.txt").write_bytes(b"1")
    (bench.path / ".hidden").write_bytes(b"2")
    (bench.path / "HUGE").write_bytes(bytes(300_000))
    (bench.path / "ÄÖ").write_bytes(b"3")
    (bench.path / "A").write_bytes(b"capital")
    (bench.path / "a").write_bytes(b"small")
    os.mkfifo(bench.path / "PIPE")
    assert bench.names() == {"A": 7}
    for name in ("LINK", "SUB", "HUGE", "PIPE"):
        with pytest.raises(FloppyError, match="write protected"):
            bench.do(bench.client.store(name, b"mine"))
    with pytest.raises(FloppyError, match="write protected"):
        bench.do(bench.client.rename("A", "LINK"))
    bench.do(bench.client.store("A", b"new"))
    assert secret.read_bytes() == b"secret"
    assert (bench.path / "HUGE").stat().st_size == 300_000
    assert ((bench.path / "A").read_bytes(), (bench.path / "a").read_bytes()) == (b"new", b"small")
    said = "\n".join(bench.said)
    assert all(what in said for what in ("LINK: no plain file", "HUGE: expected", "a: A has that name already"))


@pytest.mark.parametrize(
    "name", ["../X", "..", "a/b", "X/Y", "A.B.C", "TOOLONG", "1A", "small", "", "A\0B", ".A", "A "]
)
def test_a_name_that_could_lead_elsewhere_is_refused(bench: Bench, name: str) -> None:
    (bench.path / "OLD").write_bytes(b"old")
    directory = bench.do(bench.client.directory())
    raw = bytearray(directory.raw)
    raw[16:26] = name.encode().ljust(10, b"\0" if name == "A " else b" ")
    with pytest.raises(FloppyError, match="EF"):
        bench.do(bench.client.write(2, bytes(raw)))
    assert bench.files() == {"OLD": b"old"}
    assert not (bench.path.parent / "X").exists()


def test_read_only_is_write_protected(tmp_path: Path) -> None:
    (tmp_path / "A").write_bytes(b"old")
    bench = Bench(tmp_path, read_only=True)
    for operation in (bench.client.store("B", b"x"), bench.client.delete("A"), bench.client.rename("A", "B")):
        with pytest.raises(FloppyError, match="write protected"):
            bench.do(operation)
    assert bench.files() == {"A": b"old"}


def test_a_full_disk_is_noticed_before_anything_is_written(bench: Bench) -> None:
    bench.do(bench.client.store("A", bytes(508 * 512)))
    with pytest.raises(FloppyError, match="disk is full"):
        bench.do(bench.client.store("B", b"x"))
    for number in range(64):
        (bench.path / f"F{number}").write_bytes(b"")
    assert len(bench.names()) == 64
    with pytest.raises(FloppyError, match="directory is full"):
        bench.do(bench.client.store("B", b""))
    assert any("directory is full" in line for line in bench.said)


def test_scattered_free_blocks_are_put_together(bench: Bench) -> None:
    for number in range(5):
        bench.do(bench.client.store(f"F{number}", bytes((number,)) * 100 * 512))
    for number in (0, 2):
        bench.do(bench.client.delete(f"F{number}"))
    (bench.path / "BIG").write_bytes(b"big!" * 128 * 180)
    assert bench.do(bench.client.load("BIG")) == b"big!" * 128 * 180
    for number in (1, 3, 4):
        assert bench.do(bench.client.load(f"F{number}")) == bytes((number,)) * 100 * 512


def test_a_full_host_is_told_and_the_old_file_stays(bench: Bench) -> None:
    (bench.path / "A").write_bytes(b"old")
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, usual[1]))
    try:
        with pytest.raises(FloppyError, match=r"data check \(EF\)"):
            bench.do(bench.client.store("A", bytes(2000)))
        with pytest.raises(FloppyError, match=r"data check \(EF\)"):
            bench.do(bench.client.store("B", bytes(2000)))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
        signal.signal(signal.SIGXFSZ, handler)
    assert bench.files() == {"A": b"old"}
    assert bench.names() == {"A": 3}
    assert any("A: cannot be written: File too large" in line for line in bench.said)
    bench.do(bench.client.store("A", bytes(2000)))
    assert bench.files() == {"A": bytes(2000)}


def test_what_changed_on_the_host_meanwhile_is_not_overwritten(bench: Bench) -> None:
    (bench.path / "A").write_bytes(b"old")
    bench.names()
    steps = bench.client.store("A", b"the controller's")
    sent, moved = next(steps), False
    with pytest.raises(FloppyError, match="write protected"):
        while True:
            if sent[2:3] == b"\x03" and not moved:  # it has read the directory
                (bench.path / "A").write_bytes(b"the host's")
                (bench.path / "NEW").write_bytes(b"too")
                moved = True
            sent = steps.send(said(bench.drive, sent))
    assert bench.files() == {"A": b"the host's", "NEW": b"too"}
    assert any("has changed on the host" in line for line in bench.said)


def test_a_directory_that_nobody_has_read_is_not_written(tmp_path: Path) -> None:
    (tmp_path / "A").write_bytes(b"old")
    bench = Bench(tmp_path)
    with pytest.raises(FloppyError, match="write protected"):
        bench.do(bench.client.write(2, bytes(1024)))
    bench.names()
    bench.volume.boot()
    with pytest.raises(FloppyError, match="write protected"):
        bench.do(bench.client.write(2, bytes(1024)))
    assert bench.files() == {"A": b"old"}


def test_blocks_of_files_and_of_the_system_are_not_written(bench: Bench) -> None:
    (bench.path / "A").write_bytes(b"old")
    place = bench.do(bench.client.directory()).file("A").start
    for block in (0, 1, place):
        with pytest.raises(FloppyError, match="write protected"):
            bench.do(bench.client.write(block, b"x"))
    assert bench.do(bench.client.load("A")) == b"old"


def test_an_entry_for_blocks_that_were_not_written_is_refused(bench: Bench) -> None:
    bench.names()
    entry = PlainLayout().encode({0: Entry("A", 10, 600)})
    with pytest.raises(FloppyError, match="EF"):
        bench.do(bench.client.write(2, entry))
    bench.do(bench.client.write(10, bytes(512)))
    with pytest.raises(FloppyError, match="EF"):
        bench.do(bench.client.write(2, entry))
    bench.do(bench.client.write(11, b"x"))
    bench.do(bench.client.write(2, entry))
    assert bench.files() == {"A": bytes(512) + b"x" + bytes(87)}


def test_what_falls_out_of_use_cannot_be_had_back_unwritten(bench: Bench) -> None:
    (bench.path / "A").write_bytes(b"secret")
    file = bench.do(bench.client.directory()).file("A")
    bench.do(bench.client.delete("A"))
    with pytest.raises(FloppyError, match="EF"):
        bench.do(bench.client.write(2, PlainLayout().encode({0: Entry("B", file.start, file.length)})))
    assert bench.files() == {}


def test_the_boot_block_may_be_a_file(bench: Bench) -> None:
    (bench.path / "BOOT.BLK").write_bytes(b"my own boot block" * 100)
    assert bench.volume.boot() == (b"my own boot block" * 100)[:512]


def test_without_a_system_there_is_nothing_to_boot(bench: Bench) -> None:
    with pytest.raises(FloppyError, match="boot block"):
        bench.do(bench.client.boot())


def test_a_folder_that_is_gone_is_no_cartridge(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    bench = Bench(tmp_path / "disk")
    (tmp_path / "disk").rmdir()
    with pytest.raises(FloppyError, match=r"no cartridge \(F7\)"):
        bench.names()


def test_a_folder_is_served_once(bench: Bench, tmp_path: Path) -> None:
    with pytest.raises(FolderError, match="served by another pfloppy"):
        Folder(bench.path)
    with pytest.raises(FolderError, match="expected a folder"):
        Folder(tmp_path / "none")


def test_a_transfer_cut_at_any_byte_leaves_the_old_file(bench: Bench) -> None:
    old, new = b"old" * 700, b"new!" * 600
    (bench.path / "A").write_bytes(old)
    steps, passed = bench.client.store("A", new), 0
    sent = next(steps)
    with pytest.raises(StopIteration):
        while True:
            came = b""
            for byte in sent:
                assert bench.files() == {"A": old}
                came += said(bench.drive, bytes((byte,)))
                passed += 1
            sent = steps.send(came)
    assert passed > len(new) + 19 * 4 + 3 * 14 + 132
    assert bench.files() == {"A": new}


def save_and_die(path: Path, at_line: int) -> bool:
    """Store a file in a process that kills itself at a line of Treenail's; return whether it came so far."""
    pid = os.fork()
    if pid == 0:
        try:
            bench = Bench(path)
            bench.names()
            bench.do(bench.client.write(20, b"new" * 400))
            passed = 0

            def trace(frame: FrameType, event: str, argument: object) -> Any:
                nonlocal passed
                if "pfloppy" not in frame.f_code.co_filename:
                    return None
                passed += event == "line"
                if passed == at_line:
                    os.kill(os.getpid(), signal.SIGKILL)
                return trace

            item = bench.do(bench.client.directory()).file("A")
            entries = {item.slot: Entry("A", 20, 1200)}
            sys.settrace(trace)
            bench.volume.write(DIRECTORY.start, PlainLayout().encode(entries))
            os._exit(0)
        finally:
            os._exit(1)
    _, status = os.waitpid(pid, 0)
    assert os.WIFSIGNALED(status) or os.WEXITSTATUS(status) == 0
    return os.WIFSIGNALED(status)


def test_killed_at_any_line_of_the_commit_it_leaves_the_old_file_or_the_new(tmp_path: Path) -> None:
    old, new = b"old" * 300, b"new" * 400
    seen = set()
    (tmp_path / "A").write_bytes(old)
    at_line, step = 1, 2
    while save_and_die(tmp_path, at_line):
        left = {path.name: path.read_bytes() for path in tmp_path.iterdir() if not path.name.startswith(".")}
        assert left in ({"A": old}, {"A": new}), at_line
        seen.add(left["A"])
        (tmp_path / "A").write_bytes(old)
        at_line += step
    assert seen == {old, new}
    Folder(tmp_path).close()
    assert [path.name for path in tmp_path.iterdir()] == ["A"]


def test_a_disk_has_its_grid_and_its_end(bench: Bench) -> None:
    for offset, data in ((5000, bytes(128)), (5120, bytes(5)), (512 * 512, bytes(128)), (-128, bytes(128))):
        with pytest.raises(ValueError, match="expected"):
            bench.volume.write(offset, data)
    with pytest.raises(ValueError, match="expected"):
        bench.volume.read(0, 512 * 512 + 1)


@settings(max_examples=100)
@given(
    st.lists(
        st.one_of(
            st.tuples(st.integers(0, 2047), st.binary(min_size=1, max_size=300)),
            st.tuples(st.just(8), st.lists(ENTRIES, max_size=6).map(b"".join)),
        ),
        max_size=8,
    )
)
def test_hostile_writes_touch_nothing_but_files_on_the_disk(
    tmp_path_factory: pytest.TempPathFactory, writes: list[tuple[int, bytes]]
) -> None:
    path = tmp_path_factory.mktemp("disk")
    (path / "A").write_bytes(b"a" * 600)
    (path / "foreign.file.txt").write_bytes(b"mine")
    bench = Bench(path)
    for record, data in writes:
        bench.names()
        with contextlib.suppress(DiskError, ValueError):
            bench.volume.write(record * 128, data + bytes(-len(data) % 128))
        assert {"foreign.file.txt"} <= set(bench.files())
        seen = {file.name: bench.do(bench.client.load(file.name)) for file in bench.do(bench.client.directory()).files}
        assert seen == {name: content for name, content in bench.files().items() if name != "foreign.file.txt"}
    assert (path / "foreign.file.txt").read_bytes() == b"mine"
    assert set(path.parent.glob(f"{path.name}*")) == {path}
    bench.folder.close()
