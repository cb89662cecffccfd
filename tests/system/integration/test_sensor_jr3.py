"""The sensor service with its emulator as processes round a real router: samples, troubles, recovery, exact numbers."""

from __future__ import annotations

import random
import re
import signal
import threading
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import pytest
import zenoh

from services.rules.ft_counts import FtCounts
from services.rules.guard import Guard
from services.sensor_jr3.card import Collected, Sample
from services.sensor_jr3.emulator.card import EmulatedCard
from services.sensor_jr3.emulator.dsp import Dsp, Sensor
from services.sensor_jr3.emulator.panel import press
from services.sensor_jr3.word_server import WordServer
from services.wire.codec import decode, encode, encoding_of
from services.wire.definition import Definition
from services.wire.keys import FT, Keys
from services.wire.messages import FtPacket, Refusal

QUICK = ("--settle-s", "0")
SCALE = FtCounts("1", (65, 65, 130, 50, 50, 50))
LOADS = (
    ((0.3, -1.25, 7.123456789), (0.01, -0.02, 0.033333333333)),
    ((-12.0, 1e-9, 64.99), (3.385, 0.0, -4.9)),
    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
)
"""In N and N m."""


class Listener:
    """What is heard of ``ft`` in a cell."""

    def __init__(self, session: zenoh.Session, cell: str = "a") -> None:
        self.packets: list[FtPacket] = []
        self._subscriber = session.declare_subscriber(Keys(cell).of(FT), self._take)

    def _take(self, sample: zenoh.Sample) -> None:
        self.packets.append(decode(FtPacket, sample.payload.to_bytes(), str(sample.encoding)))

    @property
    def newest(self) -> FtPacket | None:
        return self.packets[-1] if self.packets else None

    def statuses(self, since: int = 0) -> set[int]:
        return {packet.status for packet in self.packets[since:]}


def url_in(process: Any) -> str:
    match = re.search(r"listening on (tcp://\S+)", process.out)
    return "" if match is None else match.group(1)


@pytest.fixture
def emulate(run_module: Callable[..., Any], wait_until: Callable[..., None]) -> Callable[..., tuple[Any, str]]:
    """Start an emulator; return the process and its URL."""

    def start(*options: str) -> tuple[Any, str]:
        process = run_module("services.sensor_jr3.emulator", "--calibration-s", "0.05", "--no-auto-zero", *options)
        wait_until("the emulator listens", lambda: url_in(process) or process.popen.poll() is not None)
        return process, url_in(process)

    return start


@pytest.fixture
def heard(house: Any) -> Iterator[Listener]:
    yield Listener(house.session)


def good(listener: Listener) -> Callable[[], bool]:
    """Return whether a sample has come since that says nothing bad."""
    since = len(listener.packets)
    return lambda: any(packet.status == 0 for packet in listener.packets[since:])


def test_8_khz_for_three_seconds_without_a_loss(house: Any, heard: Listener, emulate: Any) -> None:
    _, url = emulate("--load", "1,2,-3,0.1,0.2,0.3")
    house.start("sensor_jr3", "--url", url, "--rate-hz", "8000", *QUICK)

    def samples() -> list[FtPacket]:
        return [packet for packet in heard.packets if packet.status == 0]

    house.wait_until("24000 samples", lambda: sum(len(packet.force_n) for packet in samples()) >= 24_000)
    taken = samples()
    assert house.refused("sensor_jr3") == {}
    for before, after in pairwise(taken):
        assert after.sequence - len(after.force_n) == before.sequence
        assert after.t_ns > before.t_ns
    assert {packet.force_n[-1] for packet in taken} == {SCALE.quantised((1, 2, -3), (0.1, 0.2, 0.3))[0]}
    assert {packet.period_ns for packet in taken} == {125_000}
    assert {len(packet.force_n) for packet in taken} == {8}


def test_what_a_service_that_stood_still_catches_up_with_reaches_the_hearers(
    house: Any, heard: Listener, emulate: Any
) -> None:
    _, url = emulate()
    process = house.start("sensor_jr3", "--url", url, "--rate-hz", "8000", *QUICK)
    house.wait_until("samples", good(heard))
    process.popen.send_signal(signal.SIGSTOP)
    time.sleep(0.6)  # 600 packets
    process.popen.send_signal(signal.SIGCONT)
    since = len(heard.packets)
    house.wait_until("all of them and more", lambda: len(heard.packets) > since + 1200)
    taken = [packet for packet in heard.packets if packet.status == 0]
    assert [after.sequence - len(after.force_n) - before.sequence for before, after in pairwise(taken)] == [0] * (
        len(taken) - 1
    )


def test_each_trouble_stops_the_robot_and_goes_away_again(house: Any, heard: Listener, emulate: Any) -> None:
    _, url = emulate()
    house.start("sensor_jr3", "--url", url, *QUICK)
    house.wait_until("samples", good(heard))
    guard = Guard(Definition(name="any"))
    for fault, bit in (
        ("pull", 4),
        ("watchdog", 4),
        ("saturate", 1),
        ("change", 4),
        ("no_card", 4),
        ("stop", 4),
    ):
        since = len(heard.packets)
        press(url, fault, 1)
        house.wait_until(f"{fault} is told", lambda since=since, bit=bit: any(s & bit for s in heard.statuses(since)))
        told = next(packet for packet in heard.packets[since:] if packet.status & bit)
        assert guard.sensing(told, 0.0) is not None
        press(url, fault, 0)
        house.wait_until(f"{fault} is over", good(heard))
        assert guard.sensing(heard.newest, 0.0) is None
    assert set(house.refused("sensor_jr3")) >= {"NoSensorError", "NoCardError"}
    assert house.phase("sensor_jr3").startswith("running")


def test_near_saturation_is_told_and_stops_nothing(house: Any, heard: Listener, emulate: Any) -> None:
    _, url = emulate()
    house.start("sensor_jr3", "--url", url, *QUICK)
    house.wait_until("samples", good(heard))
    press(url, "near", 1)
    house.wait_until("near saturation", lambda: heard.newest is not None and heard.newest.status == 2)
    assert Guard(Definition(name="any")).sensing(heard.newest, 0.0) is None


def test_another_sensor_is_said_to_be_one(house: Any, heard: Listener, emulate: Any) -> None:
    _, url = emulate("--calibration-s", "0")
    house.start("sensor_jr3", "--url", url, *QUICK)
    house.wait_until("samples", good(heard))
    press(url, "change", 1)
    house.wait_until("status says so", lambda: any(status & 8 for status in heard.statuses()))
    house.wait_until("and it works", good(heard))
    assert "ChangedError" in house.refused("sensor_jr3")


def test_lost_samples_are_a_jump_in_the_numbers_and_are_counted(house: Any, heard: Listener, emulate: Any) -> None:
    _, url = emulate()
    house.start("sensor_jr3", "--url", url, "--rate-hz", "8000", *QUICK)
    house.wait_until("samples", good(heard))
    press(url, "drop", 37)
    house.wait_until("they are counted", lambda: house.refused("sensor_jr3").get("LostSamples", 0) == 37)
    assert house.phase("sensor_jr3") == "running, 37 samples lost"
    taken = [packet for packet in heard.packets if packet.status == 0]
    jumps = [after.sequence - len(after.force_n) - before.sequence for before, after in pairwise(taken)]
    assert {jump for jump in jumps if jump} == {37}


def test_a_card_that_dies_is_lost_and_its_successor_is_taken(house: Any, heard: Listener, emulate: Any) -> None:
    process, url = emulate("--load", "0,0,5,0,0,0")
    house.start("sensor_jr3", "--url", url, *QUICK)
    house.wait_until("samples", good(heard))
    assert process.stop(signal.SIGKILL) == -signal.SIGKILL
    house.wait_until("it is lost", lambda: heard.newest is not None and heard.newest.status == 4)
    house.wait_until("it says so", lambda: "sensor lost, trying again: tcp://" in house.phase("sensor_jr3"))
    assert heard.newest is not None
    assert heard.newest.force_n[-1] == SCALE.quantised((0, 0, 5), (0, 0, 0))[0], "the load is the one felt last"
    emulate("--load", "0,0,9,0,0,0", "--listen", url.removeprefix("tcp://"))
    house.wait_until("samples again", good(heard))
    assert heard.newest.force_n[-1] == SCALE.quantised((0, 0, 9), (0, 0, 0))[0]
    numbers = [packet.sequence for packet in heard.packets]
    assert numbers == sorted(set(numbers))
    assert [packet.t_ns for packet in heard.packets] == sorted({packet.t_ns for packet in heard.packets})


def test_a_card_that_hangs_is_lost_too(house: Any, heard: Listener, emulate: Any) -> None:
    process, url = emulate()
    house.start("sensor_jr3", "--url", url, *QUICK)
    house.wait_until("samples", good(heard))
    process.popen.send_signal(signal.SIGSTOP)
    house.wait_until("it is lost", lambda: heard.newest is not None and heard.newest.status == 4)
    process.popen.send_signal(signal.SIGCONT)
    house.wait_until("samples again", good(heard))


def test_without_a_card_it_waits_and_says_for_what(house: Any, heard: Listener) -> None:
    process = house.start("sensor_jr3", "--url", "tcp://127.0.0.1:1", *QUICK)
    house.wait_until("it tells", lambda: house.phase("sensor_jr3").startswith("sensor lost, trying again: tcp://"))
    house.wait_until("all can hear it", lambda: heard.statuses() == {4})
    replies = house.session.liveliness().get(house.keys.alive("sensor_jr3"), timeout=5.0)
    assert [reply for reply in replies if reply.ok is not None] == [], "it is not ready"
    assert process.stop() == 0
    assert process.err == ""


def test_zeroing_takes_the_load_at_the_start_away(house: Any, heard: Listener, emulate: Any) -> None:
    _, url = emulate("--load", "1,2,3,0.1,0.2,0.3")
    process = house.start("sensor_jr3", "--url", url, "--zero", *QUICK)
    house.wait_until("samples", good(heard))
    assert heard.packets[0].status == 16, "not yet zeroed"
    assert heard.newest is not None
    assert (heard.newest.force_n[-1], heard.newest.torque_nm[-1]) == ((0.0,) * 3, (0.0,) * 3)
    assert process.stop() == 0
    assert process.err == ""


def test_a_filter_a_mounting_and_full_scales_are_used(house: Any, heard: Listener, emulate: Any) -> None:
    _, url = emulate("--load", "0,8,0,0,0,0")
    options = ("--filter", "2", "--mount", "0,0,0,0,0,90", "--negate", "--full-scales", "32,32,64,10,10,10")
    house.start("sensor_jr3", "--url", url, "--rate-hz", "2000", *options, *QUICK)
    house.wait_until("samples", lambda: heard.newest is not None and heard.newest.force_n[-1] == (8.0, 0.0, 0.0))
    assert heard.newest is not None
    assert heard.newest.period_ns == 500_000


def test_a_card_server_stands_in_between(house: Any, heard: Listener, emulate: Any, run_module: Any) -> None:
    _, url = emulate("--load", "0,0,16.25,0,0,0")
    server = run_module("services.sensor_jr3.card_server", url, "--listen", "127.0.0.1:0")
    house.wait_until("the server listens", lambda: url_in(server))
    house.start("sensor_jr3", "--url", url_in(server), "--rate-hz", "8000", *QUICK)
    house.wait_until("samples", lambda: heard.newest is not None and heard.newest.force_n[-1] == (0.0, 0.0, 16.25))
    assert server.stop() == 0
    house.wait_until("it is lost", lambda: heard.newest is not None and heard.newest.status == 4)
    assert server.err == ""


def shown(house: Any, sequence: str) -> FtPacket | Refusal:
    """Return the answer of an emulator that follows cell ``world``."""
    (reply,) = house.session.get(Keys("world").of("jr3/shown") + f"?sequence={sequence}", timeout=10.0)
    found = reply.ok or reply.err
    kind: type[FtPacket] | type[Refusal] = FtPacket if reply.ok is not None else Refusal
    answer: FtPacket | Refusal = decode(kind, found.payload.to_bytes(), str(found.encoding))
    return answer


def test_what_a_simulator_feels_comes_out_to_the_last_bit(house: Any, heard: Listener, emulate: Any) -> None:
    emulator, url = emulate("--follow", "world", "--connect", house.endpoint)
    house.start("sensor_jr3", "--url", url, "--rate-hz", "8000", *QUICK)
    house.wait_until("samples", good(heard))
    publisher = house.session.declare_publisher(Keys("world").of(FT), encoding=encoding_of(FtPacket))
    house.wait_until("it follows", lambda: publisher.matching_status.matching)
    for number, (force_n, torque_nm) in enumerate(LOADS):
        packet = FtPacket(sequence=number, t_ns=number, force_n=(force_n,), torque_nm=(torque_nm,))
        publisher.put(encode(packet))
        assert shown(house, str(number)) == packet
        since = len(heard.packets)
        house.wait_until("packets after that", lambda since=since: len(heard.packets) >= since + 8)
        expected = SCALE.quantised(force_n, torque_nm)
        assert (heard.packets[-1].force_n[-1], heard.packets[-1].torque_nm[-1], False) == expected
    assert emulator.stop() == 0
    assert emulator.err == ""


def test_a_sample_is_confirmed_only_while_it_is_shown(house: Any, emulate: Any) -> None:
    emulate("--follow", "world", "--connect", house.endpoint)
    publisher = house.session.declare_publisher(Keys("world").of(FT), encoding=encoding_of(FtPacket))
    house.wait_until("it follows", lambda: publisher.matching_status.matching)
    assert isinstance(shown(house, "x"), Refusal)
    answers: list[FtPacket] = []

    def take(reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            answers.append(decode(FtPacket, reply.ok.payload.to_bytes(), str(reply.ok.encoding)))

    house.session.get(Keys("world").of("jr3/shown") + "?sequence=5", take, timeout=30.0)
    for number in (3, 6, 5):
        still = len(answers)
        packet = FtPacket(sequence=number, t_ns=number, force_n=((0.0, 0.0, 1.0),), torque_nm=((0.0, 0.0, 0.0),))
        publisher.put(encode(packet))
        assert shown(house, str(number)) == packet
        assert still == 0
    house.wait_until("the first question is answered", lambda: [packet.sequence for packet in answers] == [5])


class Corrupt(EmulatedCard):
    """A card with a bad bus: of what is read, now and then a word is another one, or a sample is nonsense."""

    chance = random.Random(3)

    def read(self, address: int, count: int) -> list[int]:
        found = super().read(address, count)
        if self.chance.random() < 0.05:
            found[self.chance.randrange(count)] = self.chance.randrange(0x10000)
        return found

    def collect(self, counter: int, data: int, wait_s: float) -> Collected:
        found = super().collect(counter, data, wait_s)
        if found.samples and self.chance.random() < 0.05:
            counts = tuple(self.chance.randrange(-32768, 32768) for _ in range(6))
            flags = self.chance.choice((0, 1, 0x8000, 0xFFFF))
            found.samples[-1] = Sample(self.chance.randrange(0x10000), counts, flags, flags)
        return found


def test_a_card_with_a_bad_bus_never_ends_the_service(house: Any, heard: Listener) -> None:
    card = Corrupt(Dsp(Sensor()))
    with WordServer(card, "127.0.0.1", 0) as server:
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()
        url = f"tcp://127.0.0.1:{server.port}"
        process = house.start("sensor_jr3", "--url", url, "--rate-hz", "8000", *QUICK, "--sensor-timeout-s", "0.2")
        house.wait_until("much goes wrong", lambda: sum(house.refused("sensor_jr3").values()) > 1000)
        house.wait_until("it goes on", good(heard))
        assert process.popen.poll() is None
        assert process.stop() == 0
        server.shutdown()
    assert process.err == ""
    numbers = [packet.sequence for packet in heard.packets]
    assert numbers == sorted(set(numbers))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--url", "comedi:/dev/comedi0"), "without sample counters and error bits"),
        (("--url", "tcp://127.0.0.1:1", "--rate-hz", "3000"), "rate: expected a divisor of 8000"),
        (("--url", "tcp://127.0.0.1:1", "--transform", "XX"), "transform: expected links"),
        ((), "the following arguments are required: --url"),
    ],
)
def test_settings_that_cannot_be_used_end_in_one_line(house: Any, options: tuple[str, ...], message: str) -> None:
    process = house.start("sensor_jr3", *options)
    assert process.end() == 2
    assert message in process.err
    assert process.err.count("\n") == 1
