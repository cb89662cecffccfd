"""DDCMP over what the operating system calls a line: a pseudo terminal and a TCP connection, in real time."""

from __future__ import annotations

import os
import re
import select
import socket
import time
import tty
from collections.abc import Callable, Iterator
from random import Random
from typing import Any

import pytest

from services.robot_link.ddcmp.events import State
from services.robot_link.ddcmp.line import Ddcmp
from services.robot_link.ddcmp.settings import DdcmpSettings
from services.robot_link.ddcmp.supervisory import SupervisoryChannel
from services.robot_link.emulator.supervisory import SupervisoryController
from services.robot_link.emulator.supervisory_line import ControllerLine

PATIENCE_S = 60.0
QUICK = DdcmpSettings(
    reply_timer_s=0.2,
    start_timer_s=0.1,
    gap_s=0.1,
    nak_pause_s=0.1,
    most_timeouts=200,
    most_naks=200,
    buffers=100,
)
Pair = tuple[int, int]


@pytest.fixture(params=("pseudo terminal", "socket"))
def line(request: pytest.FixtureRequest) -> Iterator[Pair]:
    """File numbers of both ends of a line."""
    if request.param == "socket":
        with socket.create_server(("127.0.0.1", 0)) as server:
            here = socket.create_connection(server.getsockname())
            there, _ = server.accept()
        numbers = here.detach(), there.detach()
    else:
        numbers = os.openpty()
        for number in numbers:
            tty.setraw(number)
    for number in numbers:
        os.set_blocking(number, False)
    yield numbers
    for number in numbers:
        os.close(number)


def talk(
    line: Pair,
    steps: tuple[Callable[[bytes, float], bytes], Callable[[bytes, float], bytes]],
    deadline_s: Callable[[], float | None],
    done: Callable[[], bool],
) -> None:
    """Carry bytes between the line and two ends; a step takes what came and returns what to send."""
    unsent = [steps[side](b"", time.monotonic()) for side in (0, 1)]
    end_s = time.monotonic() + PATIENCE_S
    while not done():
        now_s = time.monotonic()
        assert now_s < end_s, "the ends never agree"
        wake_s = deadline_s()
        pause_s = 1.0 if wake_s is None else min(1.0, max(0.0, wake_s - now_s))
        sending = [number for number, data in zip(line, unsent, strict=True) if data]
        readable, writable, _ = select.select(line, sending, [], pause_s)
        for side, number in enumerate(line):
            if number in writable:
                unsent[side] = unsent[side][os.write(number, unsent[side]) :]
            came = os.read(number, 4096) if number in readable else b""
            unsent[side] += steps[side](came, time.monotonic())


def turned(data: bytes, random: Random, probability: float) -> bytes:
    """Return data with bits turned over."""
    return bytes(byte ^ sum((random.random() < probability) << place for place in range(8)) for byte in data)


@pytest.mark.parametrize("bit_errors", (0.0, 1e-4))
def test_all_messages_come_once_and_in_order(line: Pair, bit_errors: float) -> None:
    ends = Ddcmp(QUICK), Ddcmp(QUICK)
    sent = [[b"%d says %d" % (side, n) * 3 for n in range(1000)] for side in (0, 1)]
    left = [list(reversed(one)) for one in sent]
    got: list[list[bytes]] = [[], []]
    random = Random(1)

    def step(side: int) -> Callable[[bytes, float], bytes]:
        end = ends[side]

        def act(came: bytes, now_s: float) -> bytes:
            out = end.start(now_s) if end.state is State.HALTED and end.failure is None else b""
            out += end.receive(turned(came, random, bit_errors), now_s).reply + end.tick(now_s).reply
            while (message := end.read()) is not None:
                got[side].append(message)
            while left[side] and end.state is State.RUNNING and end.outstanding < 16:
                out += end.send(left[side].pop(), now_s)
            assert end.failure is None
            return out

        return act

    def deadline_s() -> float | None:
        return min((end.next_deadline_s for end in ends if end.next_deadline_s is not None), default=None)

    talk(line, (step(0), step(1)), deadline_s, lambda: not any(left) and not any(end.outstanding for end in ends))
    assert got == [sent[1], sent[0]]
    assert (sum(end.counts.faults for end in ends) > 0) == (bit_errors > 0)


class Terminal:
    """Says what it was told, backwards."""

    next_deadline_s: float | None = None

    def receive(self, text: bytes, now_s: float) -> bytes:
        return text[::-1] + b"\n."

    def tick(self, now_s: float) -> bytes:
        return b""


def test_text_passes_between_the_driver_and_the_controller(line: Pair) -> None:
    host = SupervisoryChannel()
    controller = SupervisoryController(Terminal(), ControllerLine(timer_s=0.2))
    texts = [b"TYPE %d\r" % n for n in range(100)]
    heard = bytearray()
    started = set()

    def of_host(came: bytes, now_s: float) -> bytes:
        out = host.start(now_s) if "host" not in started else b""
        started.add("host")
        received = host.receive(came, now_s)
        heard.extend(received.text)
        out += received.reply + host.tick(now_s)
        assert host.failure is None
        if host.up and heard.count(b".") == 100 - len(texts) and texts:
            out += host.send(texts.pop(0), now_s)
        return out

    def of_controller(came: bytes, now_s: float) -> bytes:
        out = controller.start(now_s) if "controller" not in started else b""
        started.add("controller")
        return out + controller.receive(came, now_s) + controller.tick(now_s)

    def deadline_s() -> float | None:
        times_s = (host.next_deadline_s, controller.next_deadline_s)
        return min((time_s for time_s in times_s if time_s is not None), default=None)

    talk(line, (of_host, of_controller), deadline_s, lambda: heard.count(b".") == 100)
    assert bytes(heard) == b"".join(b"\r%s EPYT\n." % str(n)[::-1].encode() for n in range(100))
    assert controller.line.troubles == []


def test_the_emulator_process_speaks_the_supervisor_line(
    run_module: Callable[..., Any], wait_until: Callable[..., None]
) -> None:
    emulator = run_module("services.robot_link.emulator", "--mode", "supervisory")
    wait_until("port", lambda: "listening on socket://" in emulator.out or emulator.popen.poll() is not None)
    match = re.search(r"listening on socket://127\.0\.0\.1:(\d+)", emulator.out)
    assert match is not None
    with socket.create_connection(("127.0.0.1", int(match.group(1))), timeout=PATIENCE_S) as line:
        host, text = SupervisoryChannel(), b""
        line.sendall(host.start(time.monotonic()))
        for command in (b"WHERE\r", b"DO MOVE HERE:TRANS(1,2,3,0,0,0)\r", b"WHERE\r"):
            line.sendall(host.send(command, time.monotonic()))
        while text.count(b"X/JT1") < 2 or not text.endswith(b"\r\n."):
            received = host.receive(line.recv(4096), time.monotonic())
            text += received.text
            line.sendall(received.reply)
    assert host.failure is None
    before, after = ([float(word) for word in words.split()] for words in re.findall(rb"T/JT6\r\n(.*)\r\n", text))
    moved_mm = sum((new - old) ** 2 for new, old in zip(after[:3], before[:3], strict=True)) ** 0.5
    assert moved_mm == pytest.approx(14**0.5, abs=0.01)
    assert emulator.stop() == 0
