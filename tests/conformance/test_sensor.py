"""What every service that publishes ``ft`` must satisfy, as a process on a real bus.

A new sensor adds one function that makes a ``Rig``, and its name in ``RIGS``.
"""

from __future__ import annotations

import re
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import zenoh

from services.bus.session import open_client
from services.cell.ur import START_MM, arm
from services.rules.guard import Guard
from services.sensor_jr3.emulator.panel import press
from services.wire.codec import contract_sha256, decode, encoding_of
from services.wire.definition import Definition
from services.wire.keys import FT, Keys
from services.wire.messages import Alive, FtPacket

KNOWN_STATUS = 0b11111
UNUSABLE = {0: "saturated", 2: "lost", 3: "changed", 4: "not yet zeroed"}
KEYS = Keys("a")
RIGS = ("sim", "jr3", "rdt", "ur-wrist", "ros2")


@dataclass
class Bus:
    """A router, a session, and what was heard of ``ft``: payload, encoding, and when it came [s]."""

    endpoint: str
    session: zenoh.Session
    run_module: Callable[..., Any]
    wait_until: Callable[..., None]
    heard: list[tuple[bytes, str, float]] = field(default_factory=list)
    ended: threading.Event = field(default_factory=threading.Event)
    """Tells ``threads`` that the test is over."""
    threads: list[threading.Thread] = field(default_factory=list)

    def start(self, name: str, *options: str) -> Any:
        """Start a service."""
        return self.run_module(f"services.{name}", "--connect", self.endpoint, *options)

    def alive(self, name: str) -> bool:
        """Return whether a service has said that it is alive."""
        replies = self.session.liveliness().get(KEYS.alive(name), timeout=5.0)
        return any(reply.ok is not None for reply in replies)

    def packets(self, since: int = 0) -> list[FtPacket]:
        """Return all packets from one on."""
        return [decode(FtPacket, payload, encoding) for payload, encoding, _ in self.heard[since:]]

    def stands(self) -> bool:
        """Return whether a guard that hears this lets nothing move now."""
        if not self.heard:
            return True
        payload, encoding, came_s = self.heard[-1]
        return (
            Guard(Definition(name="any")).sensing(decode(FtPacket, payload, encoding), time.monotonic() - came_s)
            is not None
        )

    def wait_good(self) -> None:
        """Wait for a sample from now on with which a guard lets things move."""
        since = len(self.heard)
        guard = Guard(Definition(name="any"))
        self.wait_until("a good sample", lambda: any(guard.sensing(one, 0.0) is None for one in self.packets(since)))


@dataclass
class Rig:
    """One sensor service with all that it needs to feel something, and ways to disturb it."""

    name: str
    start: Callable[[], Any]
    """Start the service's process."""
    lose: Callable[[Any], object]
    """Take the sensor away from the running service, or the service itself where it is its own sensor."""
    mend: Callable[[], Any]
    """Undo that; return the process."""
    phase: str = "running"
    """What it says of itself then, as a regular expression."""


@pytest.fixture
def bus(short_path: Path, run_module: Any, wait_until: Any) -> Iterator[Bus]:
    endpoint = f"unixsock-stream/{short_path}/z"
    run_module("services.router", "--listen", endpoint)
    session = open_client([endpoint], 30.0)
    made = Bus(endpoint, session, run_module, wait_until)

    def take(sample: zenoh.Sample) -> None:
        made.heard.append((sample.payload.to_bytes(), str(sample.encoding), time.monotonic()))

    subscriber = session.declare_subscriber(KEYS.of(FT), take)
    yield made
    made.ended.set()
    for thread in made.threads:
        thread.join()
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    session.close()  # type: ignore[no-untyped-call]


def sim(bus: Bus, small: Path, folder: Path) -> Rig:
    """The simulator, moved by a learning cell; it is its own sensor."""
    bus.start("store", "--file", str(folder / "store.sqlite"))
    bus.start("task", "--experiment", str(small), "--episodes", "5000", "--seed", "1")
    bus.start("classifier")
    bus.start("agent")

    def start() -> Any:
        return bus.start("sim")

    return Rig("sim", start, lambda process: process.stop(signal.SIGKILL), start)


def jr3(bus: Bus, small: Path, folder: Path) -> Rig:
    """The JR3 driver on its emulator, whose plug is pulled."""
    emulator = bus.run_module("services.sensor_jr3.emulator", "--load", "1,2,3,0.1,0.2,0.3", "--calibration-s", "0.05")
    bus.wait_until("the emulator listens", lambda: re.findall(r"tcp://\S+", emulator.out))
    (url,) = re.findall(r"tcp://\S+", emulator.out)
    started: list[Any] = []

    def start() -> Any:
        started.append(bus.start("sensor_jr3", "--url", url, "--settle-s", "0"))
        return started[-1]

    def mend() -> Any:
        press(url, "pull", 0)
        return started[-1]

    return Rig("sensor_jr3", start, lambda _: press(url, "pull", 1), mend)


def rdt(bus: Bus, small: Path, folder: Path) -> Rig:
    """The RDT driver on its emulated box, whose records stop."""
    address = arm().address
    emulator = bus.run_module("services.sensor_rdt.emulator", "--listen", address, "--load", "1,2,3,0.1,0.2,0.3")
    bus.wait_until("the emulator listens", lambda: "panel on" in emulator.out)
    (page,) = re.findall(r"page (\d+)", emulator.out)
    (port,) = re.findall(r"panel on 127\.0\.0\.1:(\d+)", emulator.out)
    started: list[Any] = []

    def start() -> Any:
        started.append(bus.start("sensor_rdt", "--box", address, "--page-port", page))
        return started[-1]

    def mend() -> Any:
        push(port, "silent 0")
        return started[-1]

    return Rig("sensor_rdt", start, lambda _: push(port, "silent 1"), mend, "running.*")


def push(port: str, line: str) -> None:
    """Have the panel of an emulator do something."""
    with socket.create_connection(("127.0.0.1", int(port))) as panel:
        panel.sendall(line.encode() + b"\n")
        assert panel.recv(100) == b"done\n"


def ur_wrist(bus: Bus, small: Path, folder: Path) -> Rig:
    """The wrist of the UR arm on its emulated controller, whose cable is pulled."""
    pytest.importorskip("rtde_control", reason="pip install '.[robot_ur]'")
    address = arm().address
    emulator = bus.run_module("services.robot_ur.emulator", "--listen", address, "--load", "1,2,3,0.1,0.2,0.3")
    bus.wait_until("the emulator listens", lambda: "panel on" in emulator.out)
    (port,) = re.findall(r"panel on 127\.0\.0\.1:(\d+)", emulator.out)
    bus.start("store", "--file", str(folder / "store.sqlite"))
    bus.start("task", "--experiment", str(small), "--episodes", "5000", "--seed", "1")

    started: list[Any] = []

    def start() -> Any:
        started.append(bus.start("robot_ur", "--robot", address, "--start", START_MM, "--auto-resume"))
        return started[-1]

    def mend() -> Any:
        push(port, "pull 0")
        return started[-1]

    return Rig("robot_ur", start, lambda _: push(port, "pull 1"), mend, "running|making .*")


def ros2(bus: Bus, small: Path, folder: Path) -> Rig:
    """A WrenchStamped topic, whose driver falls silent."""
    for extra in ("rosbags", "xxhash"):
        pytest.importorskip(extra, reason="pip install '.[ros2]'")
    from services.ros2.messages import WRENCH, Messages, Wrench
    from services.ros2.node import Node

    messages, speaks, ended = Messages(), threading.Event(), bus.ended
    publish = Node(bus.session, 0, "driver", messages).publisher("/fts/wrench", WRENCH)
    speaks.set()

    def drive() -> None:
        number = 0
        while not ended.wait(0.002):
            number += 1
            if speaks.is_set():
                publish(messages.wrench(Wrench(time.time_ns(), "fts", (1.0, 2.0, number % 5), (0.1, 0.2, 0.3))))

    driver = threading.Thread(target=drive)
    driver.start()
    bus.threads.append(driver)
    started: list[Any] = []

    def start() -> Any:
        started.append(bus.start("ros2.sensor", "--topic", "/fts/wrench", "--frame", "fts", "--oldest-s", "1"))
        return started[-1]

    def mend() -> Any:
        speaks.set()
        return started[-1]

    return Rig("ros2_sensor", start, lambda _: speaks.clear(), mend, "running.*")


@pytest.fixture(params=RIGS)
def rig(request: pytest.FixtureRequest, bus: Bus, small: Path, tmp_path: Path) -> Rig:
    make: Callable[[Bus, Path, Path], Rig] = {
        "sim": sim,
        "jr3": jr3,
        "rdt": rdt,
        "ur-wrist": ur_wrist,
        "ros2": ros2,
    }[request.param]
    return make(bus, small, tmp_path)


def test_packets_follow_the_contract_and_go_on_in_order(bus: Bus, rig: Rig) -> None:
    rig.start()
    bus.wait_until("100 packets", lambda: len(bus.heard) >= 100)
    assert {encoding for _, encoding, _ in bus.heard} == {encoding_of(FtPacket)}
    packets = bus.packets()
    for packet in packets:
        assert len(packet.force_n) == len(packet.torque_nm)
        assert packet.period_ns > 0 or len(packet.force_n) == 1
        assert packet.status & ~KNOWN_STATUS == 0
    for before, after in pairwise(packets):
        if after.sequence == before.sequence:
            assert after == before, "the same number is the same sample"
            continue
        assert after.sequence - before.sequence >= len(after.force_n), "no sample comes twice"
        assert after.t_ns - before.t_ns > 0


def test_status_tells_a_guard_when_the_force_is_not_known(bus: Bus, rig: Rig) -> None:
    rig.start()
    bus.wait_good()
    guard = Guard(Definition(name="any"))
    for packet in bus.packets():
        complaint = guard.sensing(packet, 0.0)
        bad = [name for bit, name in UNUSABLE.items() if packet.status >> bit & 1]
        assert (complaint is None) == (bad == [])
        assert all(name in (complaint or "") for name in bad[:1])


def test_a_lost_sensor_stops_motion_and_a_mended_one_allows_it_again(bus: Bus, rig: Rig) -> None:
    process = rig.start()
    bus.wait_good()
    rig.lose(process)
    bus.wait_until("nothing may move", bus.stands)
    rig.mend()
    bus.wait_good()


def test_a_service_that_dies_is_replaced_by_one_that_goes_on(bus: Bus, rig: Rig) -> None:
    process = rig.start()
    bus.wait_good()
    assert process.stop(signal.SIGKILL) == -signal.SIGKILL
    bus.wait_until("nothing may move", bus.stands)
    bus.wait_until("it is gone", lambda: not bus.alive(rig.name))
    rig.start()
    bus.wait_good()
    bus.wait_until("it is back", lambda: bus.alive(rig.name))


def test_it_says_who_it_is_and_stops_when_told(bus: Bus, rig: Rig) -> None:
    process = rig.start()
    bus.wait_good()
    bus.wait_until("it is alive", lambda: bus.alive(rig.name))
    (reply,) = bus.session.get(KEYS.alive(rig.name), timeout=5.0)
    assert reply.ok is not None
    status = decode(Alive, reply.ok.payload.to_bytes(), str(reply.ok.encoding))
    assert (status.service, status.pid) == (rig.name, process.popen.pid)
    assert status.contract_sha256 == contract_sha256()
    assert re.fullmatch(rig.phase, status.phase)
    assert process.stop() == 0
    assert process.err == ""
