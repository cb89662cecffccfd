"""``treenail pfloppy`` as a process, the controller's side as another: files both ways, and killed at every byte."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import signal
import socket
import subprocess
import sys
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from services.robot_link.emulator.floppy import FloppyClient

BANNER = "VAL II STAND-IN SYSTEM"
OLD, NEW = b"the old file", b"the new one"
FORKS = """
import os, signal, sys
from treenail.tools.pfloppy.__main__ import main
for line in sys.stdin:
    pid = os.fork()
    if pid == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os._exit(main(line.split()))
    print(pid, flush=True)
    _, status = os.waitpid(pid, 0)
    print(-os.WTERMSIG(status) if os.WIFSIGNALED(status) else os.WEXITSTATUS(status), flush=True)
"""
"""Starts one pfloppy after another, each a process of its own, without waiting for Python to start every time."""


@pytest.fixture
def port() -> Iterator[socket.socket]:
    """What pfloppy connects to: the controller's end of the line."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(60)
        yield server


def url_of(server: socket.socket) -> str:
    return f"socket://127.0.0.1:{server.getsockname()[1]}"


def relay(one: socket.socket, other: socket.socket) -> None:
    """Carry bytes both ways until one side ends: the cable between two programs that both connect."""
    while True:
        for source in select.select([one, other], [], [], 60)[0]:
            data = source.recv(4096)
            if not data:
                return
            (other if source is one else one).sendall(data)


def test_a_controller_boots_and_keeps_its_files_there(
    run_module: Callable[..., Any], port: socket.socket, tmp_path: Path
) -> None:
    folder = tmp_path / "disk"
    folder.mkdir()
    (folder / "VAL.SYS").write_text(f"{BANNER}\nand the rest")
    (folder / "prog.v2").write_bytes(b"10 MOVE A\r\n")
    drive = run_module("treenail.__main__", "pfloppy", url_of(port), str(folder))
    cable, _ = port.accept()

    def controller(*words: str) -> str:
        client = run_module("treenail.tools.pfloppy.try_it", url_of(port), *words)
        end, _ = port.accept()
        with end:
            relay(cable, end)
        assert client.end() == 0, client.err
        return str(client.out)

    (tmp_path / "mine").write_bytes(bytes(range(256)) * 5)
    assert controller("BOOT", "--mrsp") == f"{BANNER}\n"
    controller("STORE", "NEW.V2", str(tmp_path / "mine"))
    controller("COPY", "NEW.V2", "COPY.V2")
    controller("DELETE", "PROG.V2")
    controller("RENAME", "NEW.V2", "OTHER.V2")
    controller("LOAD", "copy.v2", str(tmp_path / "back"))
    assert (tmp_path / "back").read_bytes() == bytes(range(256)) * 5
    listed = controller("DIR")
    assert listed.splitlines()[-1] == "3 files, 501 blocks free"
    assert {line.split()[0] for line in listed.splitlines()[:-1]} == {"VAL.SYS", "COPY.V2", "OTHER.V2"}
    assert sorted(path.name for path in folder.iterdir()) == ["COPY.V2", "OTHER.V2", "VAL.SYS"]
    assert "STAND-IN" in drive.out
    assert "not publicly known" in drive.out
    assert "never yet run on hardware" in drive.out
    assert drive.stop() == 0
    assert drive.err == ""
    cable.close()


def test_a_controller_boots_from_the_image_of_a_disk(
    run_module: Callable[..., Any], port: socket.socket, tmp_path: Path
) -> None:
    folder = tmp_path / "disk"
    folder.mkdir()
    (folder / "VAL.SYS").write_text(f"{BANNER}\nand the rest")
    for served, words in ((folder, ("IMAGE", str(tmp_path / "val2.img"))), (tmp_path / "val2.img", ("BOOT",))):
        drive = run_module("treenail.__main__", "pfloppy", url_of(port), str(served))
        cable, _ = port.accept()
        client = run_module("treenail.tools.pfloppy.try_it", url_of(port), *words)
        end, _ = port.accept()
        with cable, end:
            relay(cable, end)
        assert client.end() == 0, client.err
        assert drive.stop() == 0
    assert client.out == f"{BANNER}\n"
    assert f"unit 0 is {tmp_path / 'val2.img'}" in drive.out


def test_the_emulated_controller_boots_from_it(
    run_module: Callable[..., Any], wait_until: Callable[..., None], port: socket.socket, tmp_path: Path
) -> None:
    (tmp_path / "VAL.SYS").write_text(f"{BANNER}\nand the rest")
    drive = run_module("treenail.__main__", "pfloppy", url_of(port), str(tmp_path))
    cable, _ = port.accept()
    controller = run_module(
        "services.robot_link.emulator", "--listen", "127.0.0.1:0", "--cold", "--floppy", url_of(port)
    )
    wait_until("the controller listens", lambda: "listening on socket" in controller.out)
    where = controller.out.split("listening on socket://127.0.0.1:")[1]
    with socket.create_connection(("127.0.0.1", int(where.split()[0])), timeout=60) as terminal:

        def shown(until: bytes) -> bytes:
            seen = b""
            while until not in seen:
                seen += terminal.recv(4096)
            return seen

        shown(b"Load VAL II from floppy (Y/N)? ")
        terminal.sendall(b"Y\r")
        end, _ = port.accept()
        with end:
            relay(cable, end)
        assert f"\r\n{BANNER}\r\n".encode() in shown(b"Initialize (Y/N)? ")
    cable.close()
    assert controller.stop() == 0
    assert drive.stop() == 0


def test_a_serial_port_and_two_units(run_module: Callable[..., Any], tmp_path: Path) -> None:
    folders = [tmp_path / "zero", tmp_path / "one"]
    for folder in folders:
        folder.mkdir()
    master, slave = pty.openpty()
    tty.setraw(slave)
    drive = run_module("treenail.__main__", "pfloppy", os.ttyname(slave), *map(str, folders))
    content = bytes(range(256)) * 40
    assert os.read(master, 1) == b"\x04"
    for unit, folder in enumerate(folders):
        client = FloppyClient(unit)
        for operation in (client.wake(), client.store("A", content)):
            with contextlib.suppress(StopIteration):
                sent = next(operation)
                while True:
                    os.write(master, sent)
                    sent = operation.send(os.read(master, 4096))
        assert (folder / "A").read_bytes() == content
    assert drive.stop() == 0
    assert f"unit 0 is {folders[0]}, unit 1 is {folders[1]}" in drive.out
    os.close(master)
    os.close(slave)


def test_a_refusal_is_one_line_on_both_sides(
    run_module: Callable[..., Any], port: socket.socket, tmp_path: Path
) -> None:
    folder = tmp_path / "disk"
    folder.mkdir()
    (folder / "A").write_bytes(OLD)
    drive = run_module("treenail.__main__", "pfloppy", url_of(port), str(folder), "--read-only")
    cable, _ = port.accept()
    client = run_module("treenail.tools.pfloppy.try_it", url_of(port), "DELETE", "A")
    end, _ = port.accept()
    with cable, end:
        relay(cable, end)
    assert client.end() == 2
    assert client.err == "floppy: drive: write protected (F5) after 0 bytes\n"
    assert f"{folder}: refused: the drive was started with --read-only\n" in drive.out
    assert (folder / "A").read_bytes() == OLD


def test_a_line_that_is_lost_is_opened_again(
    run_module: Callable[..., Any], port: socket.socket, tmp_path: Path, wait_until: Callable[..., None]
) -> None:
    drive = run_module("treenail.__main__", "pfloppy", url_of(port), str(tmp_path))
    port.accept()[0].close()
    cable, _ = port.accept()
    with cable:
        cable.settimeout(60)
        assert cable.recv(1) == b"\x04"
        cable.sendall(b"\0\x04\x04")
        assert cable.recv(100).lstrip(b"\x04") == b"\x10"
        assert ": lost: " in drive.out
        wait_until("it says so", lambda: "open again" in drive.out)
        assert drive.stop(signal.SIGINT) == 0


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("/dev/no-such-port", "."), "/dev/no-such-port: cannot be opened: no such port"),
        (("nonsense://x", "."), "nonsense://x: cannot be opened"),
        (("socket://127.0.0.1", "."), "cannot be opened"),
        (("loop://", "no-such-folder"), "no-such-folder: expected a folder"),
        (("loop://", ".", "--protocol", "val2"), "--protocol: expected one of tu58, got 'val2'"),
        (("loop://", ".", "--system", "../x"), "--system: expected up to 6"),
        (("loop://", ".", "--baud", "-1"), "--baud: expected a whole number from 1"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(
    run_module: Callable[..., Any], words: tuple[str, ...], expected: str
) -> None:
    process = run_module("treenail.tools.pfloppy", *words)
    assert process.end() == 2
    (line,) = process.err.splitlines()
    assert expected in line


def test_help_says_that_it_is_a_stand_in() -> None:
    command = [sys.executable, "-m", "treenail.__main__", "pfloppy", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert "STAND-IN" in done.stdout
    assert "not publicly known" in " ".join(done.stdout.split())


def test_a_protocol_of_another_package_is_found(run_module: Callable[..., Any], tmp_path: Path) -> None:
    info = tmp_path / "site" / "mine-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[treenail.floppies]\nmine = mine_floppy:Mine\nbad = no_such:Mine\n")
    (tmp_path / "site" / "mine_floppy.py").write_text(
        "class Mine:\n    summary = 'my own protocol'\n    def __init__(self, disks): raise KeyboardInterrupt\n"
    )
    code = "from treenail.tools.pfloppy.protocols import *; print(names(), find('mine').summary); find('bad')"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stdout == "['bad', 'mine', 'tu58'] my own protocol\n"
    assert "protocol 'bad': no_such:Mine cannot be loaded: ModuleNotFoundError" in done.stderr


class Drives:
    """Starts pfloppy again and again."""

    def __init__(self, server: socket.socket, folder: Path) -> None:
        self.server, self.folder = server, folder
        pipe = subprocess.PIPE
        self.popen = subprocess.Popen([sys.executable, "-c", FORKS], stdin=pipe, stdout=pipe, text=True)

    def start(self) -> tuple[int, socket.socket]:
        """Return the process id of a new one and the controller's end of its line."""
        assert self.popen.stdin is not None
        assert self.popen.stdout is not None
        print(url_of(self.server), self.folder, file=self.popen.stdin, flush=True)
        pid = int(self.popen.stdout.readline())
        cable, _ = self.server.accept()
        cable.settimeout(60)
        cable.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        assert cable.recv(1) == b"\x04", "it has opened its line"
        return pid, cable

    def ended(self) -> int:
        """Wait for its end and return its status."""
        assert self.popen.stdout is not None
        return int(self.popen.stdout.readline())


@pytest.fixture
def drives(port: socket.socket, tmp_path: Path) -> Iterator[Drives]:
    folder = tmp_path / "disk"
    folder.mkdir()
    made = Drives(port, folder)
    yield made
    made.popen.kill()
    made.popen.communicate()


def exchange(cable: socket.socket, most: int) -> tuple[int, bool]:
    """Store a small file, but send only so many bytes; return how many were sent and whether all was confirmed."""
    client, sent, heard = FloppyClient(), 0, False
    steps = client.store("A", NEW)
    out = next(steps)
    try:
        while True:
            part = out[: most - sent]
            cable.sendall(part)
            sent += len(part)
            if sent == most:
                return sent, False
            came = cable.recv(4096)
            out = steps.send(came if heard else came.lstrip(b"\x04"))  # it may have called again
            heard = heard or came != b"\x04"
    except StopIteration:
        return sent, True


def test_killed_at_any_byte_of_a_store_it_leaves_the_old_file_or_the_new(drives: Drives) -> None:
    file = drives.folder / "A"
    most, confirmed, early = 1, False, 0
    while not confirmed:
        file.write_bytes(OLD)
        pid, cable = drives.start()
        with cable:
            _, confirmed = exchange(cable, most)
            os.kill(pid, signal.SIGKILL)
            assert drives.ended() == -signal.SIGKILL
        left = file.read_bytes()
        assert left in (OLD, NEW), most
        assert left == NEW or not confirmed
        early += left == OLD
        most += 1
    assert early >= most - 3, "only the last byte can have made the file"
    assert most == 14 + 14 + 14 + 4 + len(NEW) + 14 + 132 + 2
    pid, cable = drives.start()  # which clears away what the last one has left
    cable.close()
    os.kill(pid, signal.SIGKILL)
    assert drives.ended() == -signal.SIGKILL
    assert [path.name for path in drives.folder.iterdir()] == ["A"]
