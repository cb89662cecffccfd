"""The supervisor line: the thesis's exchange byte for byte, text both ways, damage, restarts, what is not understood.

The two ends share no code: the driver's machine meets the emulator's own.
"""

from __future__ import annotations

import argparse

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.bench.noisy_line import BYTE_S, CLEAN, Damage, OneWay
from services.robot_link.channel import Channel
from services.robot_link.ddcmp.frames import Ack, Data, Decoder, Stack, Strt, encode
from services.robot_link.ddcmp.logical_units import TABLE, Kind, LogicalUnits, prefix_of
from services.robot_link.ddcmp.settings import DdcmpError
from services.robot_link.ddcmp.supervisory import (
    HOST,
    SupervisoryChannel,
    SupervisorySettings,
    add_arguments,
    settings_of,
)
from services.robot_link.emulator.supervisory import SupervisoryController
from services.robot_link.emulator.supervisory_line import ControllerLine

READ = bytes.fromhex("02 02 00 00")
WRITE = bytes.fromhex("02 03 00 00")


class Terminal:
    """Says what it was told in capital letters, and something of its own accord at given times."""

    def __init__(self, *announcements: tuple[float, bytes]) -> None:
        self.told: list[bytes] = []
        self._announcements = list(announcements)

    @property
    def next_deadline_s(self) -> float | None:
        return self._announcements[0][0] if self._announcements else None

    def receive(self, text: bytes, now_s: float) -> bytes:
        self.told.append(text)
        return text.upper() + b"\n."

    def tick(self, now_s: float) -> bytes:
        if self._announcements and now_s >= self._announcements[0][0]:
            return self._announcements.pop(0)[1]
        return b""


class Meeting:
    """A host and a controller on a line, in calculated time."""

    def __init__(self, terminal: Terminal, damage: Damage = CLEAN, seed: int = 0) -> None:
        self.host = SupervisoryChannel()
        self.controller = SupervisoryController(terminal)
        self.now_s = 0.0
        self.text = b""
        self._to_controller, self._to_host = OneWay(damage, 2 * seed), OneWay(damage, 2 * seed + 1)

    def start(self) -> None:
        self._to_host.put(self.controller.start(self.now_s), self.now_s)
        self._to_controller.put(self.host.start(self.now_s), self.now_s)

    def start_host(self) -> None:
        self._to_controller.put(self.host.start(self.now_s), self.now_s)

    def send(self, text: bytes) -> None:
        self._to_controller.put(self.host.send(text, self.now_s), self.now_s)

    def run_until(self, end_s: float) -> None:
        """Let everything happen that happens until then."""
        while (next_s := self._next_s()) is not None and next_s <= end_s:
            self.now_s = max(self.now_s, next_s)
            self._step()
        self.now_s = end_s
        self._step()

    def _next_s(self) -> float | None:
        ends = (self.host.next_deadline_s, self.controller.next_deadline_s)
        times_s = (*ends, self._to_host.next_s, self._to_controller.next_s)
        return min((time_s for time_s in times_s if time_s is not None), default=None)

    def _step(self) -> None:
        now_s = self.now_s
        received = self.host.receive(self._to_host.take(now_s), now_s)
        self.text += received.text
        self._to_controller.put(received.reply + self.host.tick(now_s), now_s)
        came = self._to_controller.take(now_s)
        self._to_host.put(self.controller.receive(came, now_s) + self.controller.tick(now_s), now_s)


def up() -> SupervisoryChannel:
    """Return a host whose link is up and which has been asked for text once."""
    host = SupervisoryChannel()
    host.start(0.0)
    host.receive(encode(Strt()), 0.0)
    host.receive(encode(Ack(0)) + encode(Data(1, 0, READ)), 0.0)
    assert host.up
    return host


def test_the_exchange_of_the_thesis_byte_for_byte() -> None:
    """Appendix E.3: the controller begins and puts FF FF round its frames, the host answers with bare ones."""
    host, controller = SupervisoryChannel(), SupervisoryController(Terminal())
    assert host.start(0.0) == b""
    strt = controller.start(0.0)
    assert strt == bytes.fromhex("FF FF 05 06 C0 00 00 01 75 95 FF FF")
    stack = host.receive(strt, 0.1).reply
    assert stack == bytes.fromhex("05 07 C0 00 00 01 48 55")
    assert not host.up
    answer = controller.receive(stack, 0.2)
    ack = bytes.fromhex("FF FF 05 01 C0 00 00 01 C0 55 FF FF")
    read = bytes.fromhex("FF FF 81 04 C0 00 01 01 13 81 02 02 00 00 A0 78 FF FF")
    assert answer == ack + read or answer == read
    assert host.receive(answer, 0.3).reply == bytes.fromhex("05 01 C0 01 00 01 91 95")
    assert host.up
    assert host.failure is None


def test_text_goes_both_ways() -> None:
    terminal = Terminal((50.0, b"on my own\n"))
    meeting = Meeting(terminal)
    meeting.start()
    meeting.run_until(1.0)
    for n in range(300):  # numbers go round
        meeting.send(b"line %d\r" % n)
        meeting.run_until(2.0 + 0.1 * n)
    meeting.run_until(60.0)
    assert terminal.told == [b"line %d\r" % n for n in range(300)]
    said = b"".join(b"LINE %d\r\n." % n for n in range(300))
    assert meeting.text == said + b"on my own\n"
    assert meeting.controller.line.troubles == []


def test_text_waits_until_the_controller_asks_for_it() -> None:
    terminal = Terminal()
    meeting = Meeting(terminal)
    meeting.start()
    for text in (b"a", b"b", b"c"):
        meeting.send(text)
    assert terminal.told == []
    meeting.run_until(2.0)
    assert terminal.told == [b"a", b"b", b"c"]
    assert meeting.text == b"A\n.B\n.C\n."


def test_one_read_takes_one_text() -> None:
    host = up()
    first = host.send(b"first\r", 1.0)
    assert Decoder().feed(first) == [Data(1, 1, READ + b"first\r")]
    assert host.send(b"second\r", 1.0) == b""
    answer = host.receive(encode(Data(2, 1, READ)), 1.0)
    assert Decoder().feed(answer.reply) == [Ack(2), Data(2, 2, READ + b"second\r")]


def test_long_answers_come_in_several_messages() -> None:
    terminal = Terminal((1.0, bytes(range(256)) * 8))
    meeting = Meeting(terminal)
    meeting.start()
    meeting.run_until(10.0)
    assert meeting.text == bytes(range(256)) * 8


@pytest.mark.parametrize("seed", range(5))
def test_damage_on_the_line_does_not_reach_the_text(seed: int) -> None:
    terminal = Terminal()
    damage = Damage(bit_errors=3e-4, drops=0.01, duplicates=0.01, delay_s=0.1)
    meeting = Meeting(terminal, damage, seed)
    meeting.start()
    for n in range(200):
        meeting.send(b"DO MOVE HERE:TRANS(%d,0,0,0,0,0)\r" % n)
    meeting.run_until(2000.0)
    assert meeting.host.failure is None
    assert terminal.told == [b"DO MOVE HERE:TRANS(%d,0,0,0,0,0)\r" % n for n in range(200)]
    assert meeting.text == b"".join(text.upper() + b"\n." for text in terminal.told)
    assert meeting.controller.line.begun == 1


def test_a_host_that_begins_anew_is_taken_up_again() -> None:
    terminal = Terminal()
    meeting = Meeting(terminal)
    meeting.start()
    meeting.send(b"before")
    meeting.run_until(5.0)
    meeting.start_host()
    assert not meeting.host.up
    meeting.send(b"after")
    meeting.run_until(20.0)
    assert meeting.host.up
    assert terminal.told == [b"before", b"after"]
    assert meeting.controller.line.troubles == ["the host began anew"]


def test_a_controller_that_begins_anew_is_an_error_that_says_so() -> None:
    host = up()
    host.receive(encode(Strt()), 1.0)
    assert host.failure is not None
    assert "the peer began anew (STRT while running)" in host.failure
    assert not host.up
    assert host.next_deadline_s is None
    assert host.send(b"lost", 1.0) == host.tick(9.0) == b""
    assert host.receive(encode(Data(2, 0, WRITE + b"?")), 9.0) == (b"", b"")
    host.start(10.0)
    assert Decoder().feed(host.receive(encode(Strt()), 10.0).reply) == [Stack()]
    assert host.failure is None


def test_a_silent_controller_is_an_error_in_the_end() -> None:
    host = up()
    host.send(b"text", 1.0)
    while (deadline_s := host.next_deadline_s) is not None:
        host.tick(deadline_s)
    assert host.failure == "DDCMP: 9 time-outs in a row, the peer does not answer; 1 messages may be lost"


def test_a_message_that_is_not_understood_is_an_error_that_shows_it() -> None:
    host = up()
    received = host.receive(encode(Data(2, 0, WRITE + b"good")) + encode(Data(3, 0, b"\x07\x01what")), 1.0)
    assert received.text == b"good"
    expected = (
        "supervisor line: expected 02 02 00 00 alone (read) or 02 03 00 00 and text (write), got 07 01 77 68 61 74"
    )
    assert host.failure == expected
    assert host.tick(100.0) == b""


@pytest.mark.parametrize("length", (0, 509))
def test_text_that_fits_no_message_is_refused(length: int) -> None:
    with pytest.raises(DdcmpError, match=f"expected text of 1 to 508 bytes, got {length}"):
        up().send(bytes(length), 0.0)


@given(st.lists(st.tuples(st.binary(max_size=60), st.floats(0, 4)), max_size=20))
def test_any_bytes_say_nothing_to_either_side(pieces: list[tuple[bytes, float]]) -> None:
    host, terminal = up(), Terminal()
    controller = SupervisoryController(terminal)
    controller.receive(encode(Stack()) if controller.start(0.0) else b"", 0.0)
    now_s = 0.0
    for piece, pause_s in pieces:
        now_s += pause_s
        assert host.receive(piece, now_s).text == b""
        controller.receive(piece, now_s)
        host.tick(now_s)
        controller.tick(now_s)
    assert terminal.told == []


@pytest.mark.parametrize("name", TABLE)
def test_prefixes_are_the_tables(name: str) -> None:
    assert getattr(LogicalUnits(), name) == TABLE[name].prefix


def test_logical_units_tell_messages_apart() -> None:
    units = LogicalUnits()
    assert units.parse(READ) == (Kind.READ, b"")
    assert units.parse(WRITE + b"text") == (Kind.WRITE, b"text")
    same = LogicalUnits(write=READ)
    assert same.parse(READ) == (Kind.READ, b"")
    assert same.parse(READ + b"text") == (Kind.WRITE, b"text")
    assert units.message_of(b"text") == READ + b"text"


@pytest.mark.parametrize("frame", [Strt(), Stack(), Ack(3)])
def test_a_header_taken_for_a_message_is_not_understood(frame: Strt | Stack | Ack) -> None:
    """The hole that DDCMP has: a header is a good payload of 6 bytes."""
    with pytest.raises(DdcmpError, match="got 05"):
        LogicalUnits().parse(encode(frame)[:6])


def test_prefixes_that_cannot_be_told_apart_are_refused() -> None:
    with pytest.raises(DdcmpError, match=r"got 02 02 00 00 and 02 02$"):
        LogicalUnits(write=b"\x02\x02")
    with pytest.raises(DdcmpError, match="at least one byte"):
        LogicalUnits(read=b"")
    with pytest.raises(DdcmpError, match="expected hexadecimal bytes such as 02 02 00 00, got '2g'"):
        prefix_of("2g")


def parsed(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return parser.parse_args(words)


def test_options_set_the_line_and_the_prefixes() -> None:
    assert settings_of(parsed()) == SupervisorySettings(HOST, LogicalUnits())
    words = (
        "--lun-read",
        "0101",
        "--lun-answer",
        "",
        "--lun-write",
        "01 02",
        "--ddcmp-timer",
        "5",
        "--ddcmp-listen",
        "0",
    )
    settings = settings_of(parsed(*words), baud=9600)
    assert settings.units == LogicalUnits(b"\x01\x01", b"", b"\x01\x02")
    assert (settings.line.reply_timer_s, settings.line.listen_s, settings.line.byte_s) == (5.0, 0.0, BYTE_S)
    with pytest.raises(SystemExit):
        parsed("--ddcmp-timer", "0")


def test_it_is_a_channel() -> None:
    channel: Channel = SupervisoryChannel()
    assert not channel.up


# --- the controller's end by itself


def test_the_controller_repeats_strt_and_then_rep() -> None:
    line = ControllerLine(timer_s=3.0, fill=b"")
    strt = line.start(0.0)
    assert Decoder().feed(strt) == [Strt()]
    assert line.tick(2.9) == b""
    assert line.tick(3.0) == strt
    assert line.receive(encode(Stack()), 3.5) == encode(Ack(0))
    assert Decoder().feed(line.put(READ, 4.0)) == [Data(1, 0, READ)]
    reps = [line.tick(4.0 + 3 * n) for n in range(1, 9)]
    assert reps == 8 * [bytes.fromhex("05 03 C0 00 01 01 B8 05")]
    assert line.tick(4.0 + 27) == strt
    assert line.troubles == ["the host does not answer"]


def test_the_controller_asks_again_for_what_is_damaged() -> None:
    line = ControllerLine(fill=b"")
    line.start(0.0)
    line.receive(encode(Stack()), 0.0)
    data = encode(Data(1, 0, b"text"))
    assert line.receive(data[:-1] + b"\x00", 0.1) == bytes.fromhex("05 02 C2 00 00 01 85 ED")
    assert line.receive(data, 0.2) == line.receive(data, 0.3) == encode(Ack(1))
    assert line.messages == [b"text"]


def test_the_controller_forgets_what_stops_half_way() -> None:
    line = ControllerLine(fill=b"")
    line.start(0.0)
    line.receive(encode(Stack()), 0.0)
    assert line.receive(encode(Data(1, 0, bytes(400)))[:100], 0.1) == b""
    assert line.receive(encode(Data(1, 0, b"text")), 1.2) == encode(Ack(1))
    assert line.messages == [b"text"]
