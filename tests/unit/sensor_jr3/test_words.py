"""The word protocol: golden bytes, its server with a card in virtual time, and a server fed with junk."""

from __future__ import annotations

import random
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.sensor_jr3 import words
from services.sensor_jr3.card import Collected, LinkError, Sample
from services.sensor_jr3.emulator.card import MOST_COLLECTED, ROOM, EmulatedCard
from services.sensor_jr3.emulator.faults import FAULTS
from services.sensor_jr3.tcp import TcpCard
from services.sensor_jr3.word_server import WordServer

COUNTER, DATA = 0xE8, 0x90


class Clock:
    """Time that goes by only when somebody waits."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s

    def pause(self, seconds: float) -> None:
        self.now_s += seconds


@contextmanager
def serving(card: Any) -> Iterator[WordServer]:
    with WordServer(card, "127.0.0.1", 0) as server:
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()
        yield server
        server.shutdown()


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def card(bench: Callable[..., Any], clock: Clock) -> EmulatedCard:
    return EmulatedCard(bench().dsp, clock=clock, pause=clock.pause)


def test_golden_bytes() -> None:
    assert words.Question(words.READ, 0x90, 8).pack() == bytes.fromhex("0200 9000 0800 0000")
    assert words.Question(words.WRITE, 0xE7, 0x0800).pack() == bytes.fromhex("0300 e700 0008 0000")
    assert words.question(bytes.fromhex("0400 e800 9000 0500")) == (words.COLLECT, 0xE8, 0x90, 5)
    assert words.answer([1, 0xFFFE]) == bytes.fromhex("0000 0200 0100 feff")
    assert words.refusal("no") == bytes.fromhex("0100 0200 6e00 6f00")


@given(
    st.lists(
        st.builds(
            Sample,
            st.integers(0, 65535),
            st.lists(st.integers(-32768, 32767), min_size=6, max_size=6).map(tuple),
            st.integers(0, 65535),
            st.integers(0, 65535),
        ),
        max_size=20,
    ),
    st.integers(-(2**31), 2**31 - 1),
)
def test_samples_survive_the_way(samples: list[Sample], microseconds: int) -> None:
    found = words.collected_in(words.collected_words(Collected(samples, microseconds * 1e-6)))
    assert found.samples == samples
    assert round(found.newest_s * 1e6) == microseconds


def test_one_question_reads_a_whole_block(card: EmulatedCard) -> None:
    with serving(card) as server:
        there = TcpCard("127.0.0.1", server.port)
        assert there.read(0xF8, 2) == [4711, 1205]
        assert there.read(0, 0x400) == card.read(0, 0x400)
        there.write(0x88, 0xFF9C)
        assert there.read(0x90, 1) == [100]
        there.close()


def test_three_seconds_at_8_khz_come_whole_and_once(card: EmulatedCard, clock: Clock) -> None:
    with serving(card) as server:
        there = TcpCard("127.0.0.1", server.port)
        assert there.collect(COUNTER, DATA, 0.0).samples == []
        counters: list[int] = []
        while len(counters) < 24_000:
            clock.pause(0.013)
            counters += [sample.counter for sample in there.collect(COUNTER, DATA, 0.0).samples]
        assert counters == [(counters[0] + index) % 65536 for index in range(len(counters))]
        there.close()


def test_collecting_waits_for_the_first_sample(card: EmulatedCard, clock: Clock) -> None:
    card.collect(COUNTER, DATA, 0.0)
    found = card.collect(COUNTER, DATA, 0.005)
    assert 1 <= len(found.samples) <= 5
    assert 0.0 < found.newest_s <= 0.001
    before_s = clock.now_s
    card.write(FAULTS["stop"][0], 1)
    assert card.collect(COUNTER, DATA, 0.005) == ([], 0.0)
    assert clock.now_s == pytest.approx(before_s + 0.005)


def test_a_time_is_that_of_the_newest_sample_given(card: EmulatedCard, clock: Clock) -> None:
    card.collect(COUNTER, DATA, 0.0)
    clock.pause(0.5)
    found = card.collect(COUNTER, DATA, 0.0)
    assert len(found.samples) == MOST_COLLECTED
    assert found.newest_s == pytest.approx(MOST_COLLECTED / 8000 - 0.5)


def test_who_does_not_collect_loses_and_the_counter_shows_it(card: EmulatedCard, clock: Clock) -> None:
    card.collect(COUNTER, DATA, 0.0)
    clock.pause(1.5)
    samples: list[Sample] = []
    while found := card.collect(COUNTER, DATA, 0.0).samples:
        samples += found
    assert len(samples) <= ROOM
    assert samples[0].counter - 1 >= 12_000 - ROOM
    assert samples[-1].counter == 12_000


def test_dropped_samples_are_missing_and_no_others(card: EmulatedCard, clock: Clock) -> None:
    card.collect(COUNTER, DATA, 0.0)
    card.write(FAULTS["drop"][0], 3)
    clock.pause(0.01)
    counters = [sample.counter for sample in card.collect(COUNTER, DATA, 0.0).samples]
    assert counters == list(range(4, 81))


@pytest.mark.parametrize(("number", "every"), [(1, 1), (2, 4), (3, 16), (4, 64)])
def test_a_slower_counter_gives_fewer_samples(card: EmulatedCard, clock: Clock, number: int, every: int) -> None:
    card.collect(COUNTER + number - 1, DATA, 0.0)
    clock.pause(0.08)
    assert len(card.collect(COUNTER + number - 1, DATA, 0.0).samples) == 640 // every


def test_only_one_connection_collects_until_it_ends(card: EmulatedCard, clock: Clock) -> None:
    with serving(card) as server:
        first, second = (TcpCard("127.0.0.1", server.port) for _ in range(2))
        first.collect(COUNTER, DATA, 0.0)
        with pytest.raises(LinkError, match="only one who collects"):
            second.collect(COUNTER, DATA, 0.0)
        assert second.read(0xF8, 1) == [4711], "it may read all the same"
        clock.pause(0.1)
        first.close()
        while True:
            try:
                found = second.collect(COUNTER, DATA, 0.0)
                break
            except LinkError:
                continue
        assert found.samples == [], "samples taken for the first are not the second's"
        second.close()


@pytest.mark.parametrize(
    ("question", "message"),
    [
        (words.Question(9), "operation: expected 1 to 4, got 9"),
        (words.Question(words.READ, 0, 0), "read: expected 1 to 1024 words"),
        (words.Question(words.READ, 0, 1025), "read: expected 1 to 1024 words"),
        (words.Question(words.READ, 0xFFFF, 2), "read: expected"),
        (words.Question(words.COLLECT, COUNTER, 0xFFFF, 1), "collect: expected"),
        (words.Question(words.COLLECT, COUNTER, DATA, 60_000), "collect: expected at most 1000 ms"),
    ],
)
def test_a_question_that_makes_no_sense_is_refused(card: EmulatedCard, question: words.Question, message: str) -> None:
    with serving(card) as server:
        there = TcpCard("127.0.0.1", server.port)
        with pytest.raises(LinkError, match=message):
            there._ask(question)
        assert there.read(0xF8, 1) == [4711]
        there.close()


def test_junk_does_not_stop_the_server(card: EmulatedCard) -> None:
    chance = random.Random(1)
    with serving(card) as server:
        for _ in range(50):
            with socket.create_connection(("127.0.0.1", server.port)) as junk:
                junk.sendall(chance.randbytes(chance.randrange(64)))
        there = TcpCard("127.0.0.1", server.port)
        there.write(FAULTS["no_card"][0], 0)
        assert len(there.read(0xF8, 2)) == 2
        there.close()


@pytest.mark.parametrize("said", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n", b"\0\0\xff\xff", b"\0\0\4\0abcdefgh"])
def test_something_else_that_listens_is_no_card_server(said: bytes) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            connection, _ = server.accept()
            with connection:
                connection.recv(8)
                connection.sendall(said)

        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(LinkError) as caught:
            TcpCard("127.0.0.1", server.getsockname()[1])
        thread.join()
    assert "\n" not in str(caught.value)


def test_nobody_listening_is_said_in_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(LinkError, match=rf"tcp://127.0.0.1:{port}: expected a card server or emulator, got"):
        TcpCard("127.0.0.1", port)


def test_a_port_that_is_taken_is_said_in_one_line(card: EmulatedCard) -> None:
    with serving(card) as server, pytest.raises(LinkError, match="card server: cannot listen on"):
        WordServer(card, "127.0.0.1", server.port)
