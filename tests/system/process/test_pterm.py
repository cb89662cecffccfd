"""``treenail pterm`` as a process between two pseudo terminals: a person's, and a small controller's serial port."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import signal
import socket
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

CONTROLLER = r"""
import os, sys
fd, line = int(sys.argv[1]), b""
answers = {b"WHERE": "X 1.00  Y 2.00", b"BAD": "*Not understood*", b"": "", b"A": "fine"}
os.write(fd, b"\r\nVAL\r\n.")
while True:
    key = os.read(fd, 1)
    if key != b"\r":
        os.write(fd, key)
        line += key
        continue
    if line == b"HANG":
        os._exit(0)
    answer = answers.get(line, line.decode("latin-1"))
    line = b""
    os.write(fd, b"\r\n" + answer.encode() + b"\r\n" + (b"" if answer == "QUIET" else b"."))
"""
"""Echoes, answers, prompts; falls silent after QUIET, and hangs up after HANG."""

SERVER = r"""
import socket, sys
import serial.rfc2217
server = socket.socket(fileno=int(sys.argv[1]))
end, _ = server.accept()
class Out:
    def write(self, data): end.sendall(data)
port = serial.serial_for_url("loop://")
manager = serial.rfc2217.PortManager(port, Out())
while data := end.recv(1024):
    said = b"".join(manager.filter(data))
    end.sendall(b"".join(manager.escape(said.upper())))
"""
"""A serial server that sends back what it gets, in capitals."""


@pytest.fixture
def controller() -> Iterator[str]:
    """The name of the port that a small controller is on."""
    master, slave = pty.openpty()
    name = os.ttyname(slave)
    termios.tcsetattr(slave, termios.TCSANOW, raw(slave))
    popen = subprocess.Popen([sys.executable, "-c", CONTROLLER, str(master)], pass_fds=[master])
    os.close(master)
    yield name
    os.close(slave)
    popen.kill()
    popen.wait()


def raw(fd: int) -> list[Any]:
    made = termios.tcgetattr(fd)
    made[0] = made[1] = made[3] = 0
    return made


class Person:
    """Somebody at a terminal of their own, in which pterm runs."""

    def __init__(self, *words: str) -> None:
        self.master, self.slave = pty.openpty()
        self.before = termios.tcgetattr(self.slave)
        self.seen = ""
        command = [sys.executable, "-m", "treenail.__main__", "pterm", *words]
        self.popen = subprocess.Popen(command, stdin=self.slave, stdout=self.slave, stderr=self.slave)

    def sees(self, text: str) -> None:
        """Wait until a text is on the screen, and forget all up to it."""
        deadline = time.monotonic() + 60
        while text not in self.seen:
            assert time.monotonic() < deadline, f"never seen: {text!r} in {self.seen!r}"
            if select.select([self.master], [], [], 1)[0]:
                self.seen += os.read(self.master, 4096).decode()
        self.seen = self.seen.partition(text)[2]

    def types(self, keys: bytes) -> None:
        os.write(self.master, keys)

    def ends(self) -> int:
        """Wait for pterm's end, hold the terminal's settings against those before, return the exit status."""
        status = self.popen.wait(60)
        assert termios.tcgetattr(self.slave) == self.before
        return status


@pytest.fixture
def person() -> Iterator[Callable[..., Person]]:
    started: list[Person] = []

    def start(*words: str) -> Person:
        started.append(Person(*words))
        return started[-1]

    yield start
    for one in started:
        with contextlib.suppress(ProcessLookupError):
            one.popen.kill()
        one.popen.wait()
        os.close(one.master)
        os.close(one.slave)


def test_a_person_works_and_quits(person: Callable[..., Person], controller: str, tmp_path: Path) -> None:
    log = tmp_path / "log"
    one = person(controller, "--log", str(log))
    one.sees("9600 8N1; quit with Ctrl-]")
    assert termios.tcgetattr(one.slave) != one.before
    one.types(b"WHERE\r")
    one.sees("WHERE\r\nX 1.00  Y 2.00\r\n.")
    one.types(b"\x03\x1a!\r")
    one.sees("<03><1A>!\r\n<03><1A>!\r\n.")
    one.types(b"\x1d")
    assert one.ends() == 0
    assert log.read_text().endswith("WHERE\nX 1.00  Y 2.00\n.<03><1A>!\n<03><1A>!\n.")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_the_terminal_is_put_back_after_a_signal(
    person: Callable[..., Person], controller: str, number: signal.Signals
) -> None:
    one = person(controller)
    one.sees("quit with")
    one.types(b"A\r")
    one.sees("fine")
    one.popen.send_signal(number)
    assert one.ends() == 128 + number
    assert "Traceback" not in one.seen


def test_lines_are_edited_here_and_shown_once(person: Callable[..., Person], controller: str) -> None:
    one = person(controller, "--edit")
    one.sees("quit with")
    one.types(b"WHEREVER\x7f\x7f\x7f\n")
    one.sees("X 1.00  Y 2.00\r\n.")
    one.types(b"A\n")
    one.sees("A\r\nfine\r\n.")
    one.types(b"\x1d")
    assert one.ends() == 0


def test_a_file_is_sent_first_and_then_the_person_types(
    person: Callable[..., Person], controller: str, tmp_path: Path
) -> None:
    (tmp_path / "lines").write_text("ONE\nWHERE\n\nBAD\nNEVER\n")
    one = person(controller, "--send", str(tmp_path / "lines"))
    one.sees("ONE\r\nONE\r\n.WHERE\r\nX 1.00  Y 2.00\r\n.\r\n\r\n.BAD\r\n*Not understood*\r\n.")
    one.sees("the controller says '*Not understood*' after line 4 ('BAD'); 1 more not sent")
    one.types(b"A\r\x1d")
    assert one.ends() == 0


def test_a_line_that_is_gone_is_said_and_the_quit_key_still_works(
    person: Callable[..., Person], controller: str
) -> None:
    one = person(controller)
    one.sees("quit with")
    one.types(b"HANG\r")
    one.sees("lost: ")
    one.sees("trying again every 1 s")
    one.types(b"x\x1d")
    assert one.ends() == 0


def test_a_line_that_comes_back_is_used_again(person: Callable[..., Person]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(60)
        one = person(f"socket://127.0.0.1:{server.getsockname()[1]}", "--line-end", "crlf")
        server.accept()[0].close()
        one.sees("lost: ")
        cable, _ = server.accept()
        with cable:
            cable.settimeout(60)
            one.sees("open again")
            one.types(b"hello\r")
            came = b""
            while len(came) < 7:
                came += cable.recv(100)
            assert came == b"hello\r\n"
            cable.sendall(b"back\r\n")
            one.sees("back\r\n")
            one.types(b"\x1d")
            assert one.ends() == 0


def script(text: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Run pterm with a pipe as standard input."""
    command = [sys.executable, "-m", "treenail.__main__", "pterm", *words]
    return subprocess.run(command, input=text, capture_output=True, text=True, timeout=60, check=False)


def test_a_pipe_is_sent_line_by_line(controller: str) -> None:
    done = script("WHERE\nA", controller)
    assert done.stdout.endswith("WHERE\nX 1.00  Y 2.00\n.A\nfine\n.")
    assert (done.returncode, done.stderr) == (0, f"pterm: {controller} 9600 8N1\n")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("A\nBAD\nNEVER\n", "the controller says '*Not understood*' after line 2 ('BAD'); 1 more not sent"),
        ("QUIET\nNEVER\n", "no prompt within 1 s after line 1 ('QUIET'); 1 more not sent"),
        ("HANG\nNEVER\n", "the line was lost after line 1 ('HANG'); 1 more not sent"),
    ],
)
def test_a_script_that_cannot_go_on_says_where(controller: str, text: str, why: str) -> None:
    done = script(text, controller, "--patience", "1")
    assert done.stderr.splitlines()[-1] == f"pterm: {why}"
    assert done.returncode == 1
    assert "NEVER" not in done.stdout


def test_a_port_in_use_is_said_in_one_line(person: Callable[..., Person], controller: str) -> None:
    person(controller).sees("quit with")
    done = script("", controller)
    assert done.stderr == f"treenail pterm: {controller}: cannot be opened: in use by another program\n"
    assert done.returncode == 2


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("/dev/no-such-port",), "/dev/no-such-port: cannot be opened: no such port"),
        (("socket://127.0.0.1:1",), "socket://127.0.0.1:1: cannot be opened"),
        (("loop://", "--send", "/no/such/file"), "/no/such/file: cannot be read"),
        (("loop://", "--log", "/no/such/file"), "/no/such/file: cannot be written"),
        (("loop://", "--prompt", "("), "--prompt: expected a regular expression"),
        (("loop://", "--patience", "0"), "--patience: expected from 0.01"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(words: tuple[str, ...], expected: str) -> None:
    done = script("", *words)
    (line,) = done.stderr.splitlines()
    assert expected in line
    assert done.returncode == 2


def test_a_log_on_a_full_disk_is_said_and_the_work_goes_on(controller: str) -> None:
    done = script("A\n", controller, "--log", "/dev/full")
    assert done.stdout.endswith("A\nfine\n.")
    assert "the log cannot be written any more: No space left on device" in done.stderr
    assert done.returncode == 0


def test_standard_output_that_nobody_reads_is_one_line(controller: str) -> None:
    with open("/dev/full", "wb") as full:
        command = [sys.executable, "-m", "treenail.__main__", "pterm", controller]
        done = subprocess.run(command, input=b"A\n", stdout=full, stderr=subprocess.PIPE, timeout=60, check=False)
    assert done.stderr.decode().splitlines()[1:] == ["treenail pterm: standard output: No space left on device"]
    assert done.returncode == 2


def test_a_port_without_a_file_number_works_too() -> None:
    done = script("hello\n", "loop://", "--prompt", "", "--quiet", "0.05")
    assert done.stdout == "hello\n"
    assert done.returncode == 0


def test_a_port_over_the_network_works_and_is_missed_when_gone(
    person: Callable[..., Person],
) -> None:
    """RFC 2217, as serial servers speak it: pyserial's own server side stands in for one."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        popen = subprocess.Popen([sys.executable, "-c", SERVER, str(server.fileno())], pass_fds=[server.fileno()])
        try:
            one = person(f"rfc2217://127.0.0.1:{server.getsockname()[1]}")
            one.sees("quit with")
            one.types(b"hello\r")
            one.sees("HELLO\r\n")
        finally:
            popen.kill()
            popen.wait()
    one.sees("lost: ")
    one.types(b"\x1d")
    assert one.ends() == 0
