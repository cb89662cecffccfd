"""The emulated box, judged by two clients that are not ours, and our service on it when luck is bad."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from services.bus.testing import FakeService
from services.cell.ur import arm
from services.rules.guard import Guard
from services.sensor_rdt.box import calibrated
from services.sensor_rdt.errors import CalibrationError
from services.sensor_rdt.service import RdtShell
from services.sensor_rdt.settings import Settings
from services.wire.definition import Definition
from services.wire.messages import FtPacket

LOAD = (1.5, -2.25, 3.0, 0.125, -0.25, 0.5)


class Emulator:
    """A box as a process."""

    def __init__(self, log: Path) -> None:
        self.address = arm().address
        words = ["-m", "services.sensor_rdt.emulator", "--listen", self.address, "--load", ",".join(map(str, LOAD))]
        with log.open("wb") as out:
            self._process = subprocess.Popen([sys.executable, *words], stdout=out, stderr=subprocess.STDOUT)
        deadline = time.monotonic() + 30.0
        while "panel on" not in log.read_text():
            assert time.monotonic() < deadline, log.read_text()
            time.sleep(0.01)
        self.page_port = int(re.findall(r"page (\d+)", log.read_text())[0])
        self._panel = int(re.findall(r"panel on 127\.0\.0\.1:(\d+)", log.read_text())[0])

    @property
    def settings(self) -> Settings:
        """Of our service."""
        return Settings(self.address, page_port=self.page_port)

    def press(self, line: str) -> str:
        """Return what the panel answers."""
        with socket.create_connection(("127.0.0.1", self._panel)) as panel:
            panel.sendall(f"{line}\n".encode())
            return panel.recv(4096).decode().strip()

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.wait()


@pytest.fixture
def emulator(tmp_path: Path) -> Iterator[Emulator]:
    made = Emulator(tmp_path / "emulator.log")
    yield made
    made.close()


def test_pynetft_reads_it(emulator: Emulator) -> None:
    pynetft = pytest.importorskip("pynetft")
    with pynetft.Client(pynetft.Config(sensor_host=emulator.address, http_port=emulator.page_port)) as client:
        client.start()
        assert client.wait_for_first_sample(10.0)
        sample = client.latest_sample()
        assert sample.wrench == pytest.approx(LOAD)
        assert sample.status == 0


def test_netft_reads_it(emulator: Emulator) -> None:
    netft: Any = pytest.importorskip("NetFT")
    sensor = netft.Sensor(emulator.address)
    assert sensor.getMeasurement() == [round(1e6 * value) for value in LOAD]
    sensor.sock.close()


def test_a_calibration_that_is_absent_is_said(emulator: Emulator) -> None:
    emulator.press("pageless 1")
    with pytest.raises(CalibrationError, match="HTTP 404"):
        calibrated(emulator.settings)
    with pytest.raises(CalibrationError, match=r"say --counts-per-force"):
        calibrated(Settings("127.254.253.251", page_port=emulator.page_port))
    said = Settings(emulator.address, counts_per_force=1e6, counts_per_torque=1e6)
    assert calibrated(said).counts_per_n == 1e6


class Sensing:
    """Our shell on the box, in real time: the loop of a service without a bus waits for nothing by itself."""

    def __init__(self, settings: Settings) -> None:
        self.service = FakeService("sensor_rdt")
        self.service.claim()
        work = self.service.clock.work

        def paced(timeout_s: float) -> bool:
            time.sleep(min(timeout_s, 0.001))
            return work(timeout_s)

        self.service.clock.work = paced  # type: ignore[method-assign]
        self._thread = threading.Thread(target=RdtShell(self.service, settings).run)
        self._thread.start()

    @property
    def packets(self) -> list[FtPacket]:
        """All that was published."""
        return self.service.published(FtPacket)

    def until(self, holds: Any) -> None:
        """Wait until something holds of the newest packet."""
        deadline = time.monotonic() + 30.0
        while not (self.packets and holds(self.packets[-1])):
            assert time.monotonic() < deadline, (self.service.phase, dict(self.service.refused))
            time.sleep(0.02)

    def close(self) -> None:
        """Stop it."""
        self.service.stop()
        self._thread.join()


@pytest.fixture
def sensing(emulator: Emulator) -> Iterator[Sensing]:
    made = Sensing(emulator.settings)
    yield made
    made.close()


def good(packet: FtPacket) -> bool:
    """Return whether a guard lets things move with a packet."""
    return Guard(Definition(name="any")).sensing(packet, 0.0) is None


def test_counts_become_newton(sensing: Sensing) -> None:
    sensing.until(good)
    newest = sensing.packets[-1]
    assert (*newest.force_n[-1], *newest.torque_nm[-1]) == pytest.approx(LOAD)


def test_a_sensor_that_is_rebooted_is_lost_and_taken_up_again(sensing: Sensing, emulator: Emulator) -> None:
    sensing.until(good)
    emulator.press("off")  # until its loss is noticed, however busy this machine is
    sensing.until(lambda packet: packet.status == 4)
    assert not good(sensing.packets[-1])
    emulator.press("on")
    sensing.until(good)


def test_another_sensor_at_the_same_address_is_said(sensing: Sensing, emulator: Emulator) -> None:
    sensing.until(good)
    emulator.press("another")
    sensing.until(lambda packet: packet.status == 8 or any(one.status == 8 for one in sensing.packets))
    sensing.until(good)
    assert sensing.packets[-1].force_n[-1] == pytest.approx(LOAD[:3])


def test_a_pulled_cable_and_a_fault_let_nothing_move(sensing: Sensing, emulator: Emulator) -> None:
    sensing.until(good)
    emulator.press("silent 1")
    sensing.until(lambda packet: not good(packet))
    emulator.press("silent 0")
    sensing.until(good)
    emulator.press("status 90000000")
    sensing.until(lambda packet: not good(packet))
    sensing.until(lambda _: "analog board" in sensing.service.phase)
    emulator.press("status 0")
    sensing.until(good)


def test_packets_that_are_lost_repeated_or_late_are_counted(sensing: Sensing, emulator: Emulator) -> None:
    sensing.until(good)
    for line in ("drop 5", "repeat 3", "swap 2", "garbage 2"):
        emulator.press(line)
    refused = sensing.service.refused
    sensing.until(
        lambda _: refused["RepeatedSamples"] >= 3 and refused["LateSamples"] >= 2 and refused["OddPackets"] >= 2
    )
    assert refused["LostSamples"] >= 5
    numbers = [packet.sequence for packet in sensing.packets]
    assert numbers == sorted(set(numbers))


def test_commands_are_sent_before_the_stream(emulator: Emulator) -> None:
    made = Sensing(
        Settings(emulator.address, page_port=emulator.page_port, zero=True, onrobot_filter=4, onrobot_period_ms=2)
    )
    made.until(good)
    assert emulator.press("heard").split()[:5] == ["0:0", "81:4", "82:2", "42:0", "2:0"]
    assert made.packets[-1].force_n[-1] == (0.0, 0.0, 0.0)
    made.close()
