"""DDCMP's machine: start-up, acknowledgement, refusal, REP, limits, restarts, numbers that go round, hostile bytes."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.robot_link.ddcmp.crc16 import with_crc
from services.robot_link.ddcmp.events import Event, Halted, Refused, Started, State
from services.robot_link.ddcmp.frames import (
    Ack,
    Data,
    Decoder,
    Nak,
    Reason,
    Received,
    Rep,
    Sendable,
    Stack,
    Strt,
    encode,
)
from services.robot_link.ddcmp.line import Ddcmp
from services.robot_link.ddcmp.settings import DdcmpError, DdcmpSettings

LONG_AGO, NOW_S = 0.0, 100.0
MAINTENANCE = with_crc(bytes.fromhex("90 04 C0 00 00 01")) + with_crc(b"boot")


def frames(data: bytes) -> list[Received]:
    return Decoder(16383).feed(data)


def put(end: Ddcmp, *given: Sendable, now_s: float = NOW_S) -> list[Received]:
    """Give frames to an end; return its answer."""
    return frames(end.receive(b"".join(encode(frame) for frame in given), now_s).reply)


def events(end: Ddcmp, *given: Sendable, now_s: float = NOW_S) -> tuple[Event, ...]:
    return end.receive(b"".join(encode(frame) for frame in given), now_s).events


def running(**settings: object) -> Ddcmp:
    """Return an end whose peer answered its STRT."""
    end = Ddcmp(DdcmpSettings(**settings))  # type: ignore[arg-type]
    assert frames(end.start(LONG_AGO)) == [Strt()]
    assert put(end, Stack(), now_s=LONG_AGO) == [Ack(0)]
    assert end.state is State.RUNNING
    return end


def read_all(end: Ddcmp) -> list[bytes]:
    found = []
    while (message := end.read()) is not None:
        found.append(message)
    return found


def at_deadline(end: Ddcmp) -> tuple[list[Received], tuple[Event, ...]]:
    """Let time pass until the end does something by itself."""
    deadline_s = end.next_deadline_s
    assert deadline_s is not None
    early = end.tick(deadline_s - 0.001)
    assert early == (b"", ())
    done = end.tick(deadline_s)
    return frames(done.reply), done.events


# --- start-up


def test_strt_is_answered_with_stack_and_ack_begins() -> None:
    end = Ddcmp()
    assert frames(end.start(NOW_S)) == [Strt()]
    assert put(end, Strt()) == [Stack()]
    assert put(end, Strt()) == [Stack()]
    assert end.state is State.ANSWERED
    assert events(end, Ack(0)) == (Started(),)
    assert frames(end.send(b"text", NOW_S)) == [Data(1, 0, b"text")]


def test_data_begins_as_well_as_ack() -> None:
    end = Ddcmp()
    end.start(NOW_S)
    put(end, Strt())
    assert put(end, Data(1, 0, b"first")) == [Ack(1)]
    assert read_all(end) == [b"first"]


def test_stack_begins_and_is_acknowledged_again_when_repeated() -> None:
    end = running()
    assert put(end, Stack()) == [Ack(0)]


def test_what_belongs_to_an_earlier_run_begins_nothing() -> None:
    end = Ddcmp()
    end.start(NOW_S)
    assert put(end, Ack(0), Data(1, 0, b"old"), Rep(3), Nak(Reason.DATA_CRC, 0)) == []
    put(end, Strt())
    assert put(end, Ack(7), Data(8, 7, b"old")) == []
    assert end.state is State.ANSWERED
    assert read_all(end) == []


def test_strt_and_stack_are_repeated_without_end() -> None:
    end = Ddcmp()
    end.start(NOW_S)
    for _ in range(50):
        assert at_deadline(end) == ([Strt()], ())
    put(end, Strt())
    for _ in range(50):
        assert at_deadline(end) == ([Stack()], ())


def test_both_begin_at_once() -> None:
    left, right = Ddcmp(), Ddcmp()
    to_right, to_left = left.start(NOW_S), right.start(NOW_S)
    for _ in range(3):
        to_right, to_left = left.receive(to_left, NOW_S).reply, right.receive(to_right, NOW_S).reply
    assert left.state is right.state is State.RUNNING
    assert left.failure is right.failure is None


def test_a_listener_lets_the_peer_begin() -> None:
    end = Ddcmp(DdcmpSettings(listen_s=7.0))
    assert end.start(NOW_S) == b""
    assert put(end, Stack(), Ack(0), Data(1, 0, b"x")) == []
    assert put(end, Strt()) == [Stack()]
    assert events(end, Ack(0)) == (Started(),)


def test_a_listener_begins_when_it_hears_nothing() -> None:
    end = Ddcmp(DdcmpSettings(listen_s=7.0))
    end.start(NOW_S)
    assert end.next_deadline_s == NOW_S + 7.0
    assert at_deadline(end) == ([Strt()], ())
    assert put(end, Stack()) == [Ack(0)]


def test_flags_and_fill() -> None:
    plain = running(flags_on_all=False)
    assert plain.send(b"text", NOW_S) == encode(Data(1, 0, b"text"), 0)
    assert Ddcmp(DdcmpSettings(flags_on_all=False)).start(NOW_S) == encode(Strt())
    val = running(fill=b"\xff\xff")
    assert val.send(b"text", NOW_S) == b"\xff\xff" + encode(Data(1, 0, b"text")) + b"\xff\xff"


# --- data


def test_messages_are_numbered_and_acknowledged_together() -> None:
    end = running()
    sent = [frames(end.send(text, NOW_S)) for text in (b"a", b"b", b"c")]
    assert sent == [[Data(1, 0, b"a")], [Data(2, 0, b"b")], [Data(3, 0, b"c")]]
    assert put(end, Ack(2)) == []
    assert end.outstanding == 1
    assert put(end, Data(1, 3, b"x"), Data(2, 3, b"y")) == [Ack(2)]
    assert end.outstanding == 0
    assert end.next_deadline_s is None
    assert frames(end.send(b"d", NOW_S)) == [Data(4, 2, b"d")]


def test_a_message_comes_once_though_it_is_sent_again() -> None:
    end = running()
    assert put(end, Data(1, 0, b"x")) == [Ack(1)]
    assert put(end, Data(1, 0, b"x")) == [Ack(1)]
    assert put(end, Data(2, 0, b"y")) == [Ack(2)]
    assert put(end, Data(1, 0, b"x")) == [Ack(2)]
    assert read_all(end) == [b"x", b"y"]
    assert end.counts.duplicates == 2


def test_a_message_after_a_missing_one_is_dropped() -> None:
    end = running()
    assert put(end, Data(2, 0, b"y")) == []
    assert put(end, Data(1, 0, b"x"), Data(2, 0, b"y")) == [Ack(2)]
    assert read_all(end) == [b"x", b"y"]
    assert end.counts.out_of_sequence == 1


def test_an_impossible_acknowledgement_is_ignored() -> None:
    end = running()
    end.send(b"a", NOW_S)
    for frame in (Ack(2), Ack(255), Nak(Reason.DATA_CRC, 9), Data(5, 4, b"z")):
        assert put(end, frame) == []
    assert end.outstanding == 1
    assert end.state is State.RUNNING


def test_at_most_a_window_is_under_way() -> None:
    end = running()
    sent = [frame for n in range(300) for frame in frames(end.send(b"%d" % n, NOW_S))]
    assert len(sent) == 255
    assert end.outstanding == 300
    released = put(end, Ack(10))
    assert released == [Data(n % 256, 0, b"%d" % (n - 1)) for n in range(256, 266)]
    assert put(end, Ack(10)) == []
    assert len(put(end, Ack((10 + 255) % 256))) == 35


def test_numbers_go_round() -> None:
    end = running()
    for n in range(1, 1001):
        number = n % 256
        assert frames(end.send(b"out", NOW_S)) == [Data(number, (n - 1) % 256, b"out")]
        assert put(end, Data(number, number, b"in %d" % n)) == [Ack(number)]
        assert read_all(end) == [b"in %d" % n]
    assert (end.counts.sent, end.counts.received, end.outstanding) == (1000, 1000, 0)


def test_a_rep_for_a_full_window_is_told_from_one_for_an_empty_one() -> None:
    sender, receiver = running(), running(buffers=255)
    data = b"".join(sender.send(b"%d" % n, NOW_S) for n in range(255))
    (rep,), _ = at_deadline(sender)
    assert put(receiver, Rep(255)) == [Nak(Reason.REPLY, 0)]
    assert rep == Rep(255)
    receiver.receive(data, NOW_S)
    assert put(receiver, Rep(255)) == [Ack(255)]
    assert read_all(receiver) == [b"%d" % n for n in range(255)]


# --- refusal


@pytest.mark.parametrize("place", range(len(encode(Data(1, 0, b"text")))))
def test_a_damaged_message_is_asked_for_and_comes(place: int) -> None:
    sender, receiver = running(), running()
    data = bytearray(sender.send(b"text", NOW_S))
    data[place] ^= 0x10
    reply = receiver.receive(bytes(data), NOW_S).reply + receiver.tick(NOW_S + 1).reply
    reason = Reason.HEADER_CRC if place < 8 else Reason.DATA_CRC
    assert frames(reply) == [Nak(reason, 0)]
    again = sender.receive(reply, NOW_S + 1).reply
    assert frames(again) == [Data(1, 0, b"text")]
    receiver.receive(again, NOW_S + 1)
    assert read_all(receiver) == [b"text"]


def test_a_nak_acknowledges_and_brings_the_rest_before_what_waited() -> None:
    end = running(window=3)
    for text in (b"a", b"b", b"c", b"d", b"e"):
        end.send(text, NOW_S)
    assert put(end, Nak(Reason.DATA_CRC, 1)) == [Data(2, 0, b"b"), Data(3, 0, b"c"), Data(4, 0, b"d")]


def test_damage_in_one_flight_is_reported_once() -> None:
    end = running(nak_pause_s=1.0)
    damaged = encode(Data(1, 0, b"a"))[:-1] + b"\x00"
    assert frames(end.receive(damaged * 5, NOW_S).reply) == [Nak(Reason.DATA_CRC, 0)]
    assert frames(end.receive(damaged, NOW_S + 0.9).reply) == []
    assert frames(end.receive(damaged, NOW_S + 1.0).reply) == [Nak(Reason.DATA_CRC, 0)]
    assert put(end, Data(1, 0, b"a"), now_s=NOW_S + 1.1) == [Ack(1)]
    assert frames(end.receive(damaged, NOW_S + 1.2).reply) == [Nak(Reason.DATA_CRC, 1)]


def test_a_message_is_asked_for_though_its_number_was_a_round_ago() -> None:
    end = running(buffers=1000)
    damaged = encode(Data(1, 0, b"a"))[:-1] + b"\x00"
    assert frames(end.receive(damaged, NOW_S).reply) == [Nak(Reason.DATA_CRC, 0)]
    for number in range(1, 257):
        put(end, Data(number % 256, 0, b"a"))
    assert frames(end.receive(damaged, NOW_S).reply) == [Nak(Reason.DATA_CRC, 0)]


def test_a_bad_message_still_acknowledges_ours() -> None:
    end = running()
    end.send(b"a", NOW_S)
    damaged = encode(Data(1, 1, b"a"))[:-1] + b"\x00"
    assert frames(end.receive(damaged, NOW_S).reply) == [Nak(Reason.DATA_CRC, 0)]
    assert end.outstanding == 0


def test_no_buffer_is_said_and_waited_for() -> None:
    sender, receiver = running(), running(buffers=2)
    data = b"".join(sender.send(text, NOW_S) for text in (b"a", b"b", b"c", b"d"))
    assert frames(reply := receiver.receive(data, NOW_S).reply) == [Nak(Reason.NO_BUFFER, 2)]
    assert sender.receive(reply, NOW_S).reply == b""
    assert read_all(receiver) == [b"a", b"b"]
    (rep,), _ = at_deadline(sender)
    assert rep == Rep(4)
    assert put(receiver, Rep(4)) == [Nak(Reason.REPLY, 2)]
    again = put(sender, Nak(Reason.REPLY, 2), now_s=NOW_S + 4)
    assert again == [Data(3, 0, b"c"), Data(4, 0, b"d")]
    assert put(receiver, Data(3, 0, b"c"), Data(4, 0, b"d")) == [Ack(4)]
    assert read_all(receiver) == [b"c", b"d"]


def test_a_message_that_is_too_long_is_refused() -> None:
    end = running(max_message=8)
    assert put(end, Data(1, 0, b"123456789")) == [Nak(Reason.TOO_LONG, 0)]
    assert put(end, Data(1, 0, b"12345678")) == [Ack(1)]


def test_maintenance_is_refused_and_the_line_goes_on() -> None:
    end = running()
    outcome = end.receive(MAINTENANCE, NOW_S)
    assert outcome == (b"", (Refused("DDCMP: expected data or control frames, got a maintenance frame"),))
    assert put(end, Data(1, 0, b"x")) == [Ack(1)]


# --- time


def test_silence_is_answered_with_rep_never_with_the_data() -> None:
    end = running()
    end.send(b"a", NOW_S)
    end.send(b"b", NOW_S + 1)
    assert end.next_deadline_s == NOW_S + 3
    assert at_deadline(end) == ([Rep(2)], ())
    assert put(end, Nak(Reason.REPLY, 1), now_s=NOW_S + 4) == [Data(2, 0, b"b")]
    assert put(end, Ack(2), now_s=NOW_S + 4) == []
    assert end.next_deadline_s is None


def test_the_timer_begins_when_a_message_has_left() -> None:
    end = running(byte_s=0.01)
    assert len(end.send(b"12345678", NOW_S)) == 18
    assert end.next_deadline_s == pytest.approx(NOW_S + 0.18 + 3.0)


def test_messages_leave_one_after_the_other_and_no_time_out_is_counted_meanwhile() -> None:
    end = running(byte_s=0.1)
    sent = [end.send(b"12345678", NOW_S) for _ in range(4)]
    assert [len(data) for data in sent] == [18, 0, 0, 0]
    assert [at_deadline(end) for _ in range(2)] == [([Data(n, 0, b"12345678")], ()) for n in (2, 3)]
    assert at_deadline(end) == ([], ())  # the reply timer of the first, while the third is leaving
    assert at_deadline(end) == ([Data(4, 0, b"12345678")], ())
    assert end.counts.timeouts == 0
    assert end.next_deadline_s == pytest.approx(NOW_S + 3 * 1.8 + 3.0)
    assert at_deadline(end) == ([Rep(4)], ())


def test_a_nak_changes_what_leaves_next() -> None:
    end = running(byte_s=0.01)
    for text in (b"a", b"b", b"c", b"d"):
        end.send(text, NOW_S)
    assert at_deadline(end)[0] == [Data(2, 0, b"b")]
    assert put(end, Nak(Reason.DATA_CRC, 0), now_s=NOW_S + 0.2) == []
    assert [at_deadline(end)[0] for _ in range(4)] == [[Data(n, 0, b"abcd"[n - 1 : n])] for n in range(1, 5)]
    assert (end.counts.sent, end.counts.sent_again) == (4, 2)


@pytest.mark.parametrize("most", (1, 8))
def test_too_many_time_outs_in_a_row_halt_the_line(most: int) -> None:
    end = running(most_timeouts=most)
    end.send(b"a", NOW_S)
    for _ in range(most):
        assert at_deadline(end) == ([Rep(1)], ())
    why = f"DDCMP: {most + 1} time-outs in a row, the peer does not answer; 1 messages may be lost"
    assert at_deadline(end) == ([], (Halted(why),))
    assert end.failure == why
    assert end.next_deadline_s is None
    assert end.receive(encode(Ack(1)), NOW_S) == end.tick(NOW_S) == (b"", ())


def test_an_answer_between_time_outs_counts_anew() -> None:
    end = running()
    for number in range(1, 20):
        end.send(b"a", 100.0 * number)
        for _ in range(8):
            assert at_deadline(end) == ([Rep(number)], ())
        put(end, Ack(number), now_s=100.0 * number + 50)
    assert end.state is State.RUNNING


def test_too_many_naks_in_a_row_halt_the_line() -> None:
    end = running()
    end.send(b"a", NOW_S)
    for _ in range(8):
        assert put(end, Nak(Reason.TOO_LONG, 0)) == [Data(1, 0, b"a")]
    (halted,) = events(end, Nak(Reason.TOO_LONG, 0))
    why = "DDCMP: 9 NAKs in a row, the last with reason 16 (too long); 1 messages may be lost"
    assert halted == Halted(why)


def test_a_nak_when_nothing_is_under_way_is_harmless() -> None:
    end = running()
    for _ in range(100):
        assert put(end, Nak(Reason.HEADER_CRC, 0)) == []
    assert end.state is State.RUNNING


def test_a_frame_that_stops_half_way_is_given_up() -> None:
    end = running()
    end.receive(encode(Data(1, 0, bytes(400)))[:100], NOW_S)
    assert at_deadline(end) == ([Nak(Reason.DATA_CRC, 0)], ())
    end.receive(encode(Data(1, 0, bytes(400)))[:100], NOW_S + 10)
    late = end.receive(encode(Data(1, 0, b"x")), NOW_S + 20).reply
    assert frames(late) == [Nak(Reason.DATA_CRC, 0), Ack(1)]


# --- restarts


def test_a_peer_that_begins_anew_is_an_error_that_says_so() -> None:
    end = running()
    end.send(b"a", NOW_S)
    (halted,) = events(end, Strt())
    assert halted == Halted("DDCMP: the peer began anew (STRT while running); 1 messages may be lost", restarted=True)
    assert end.state is State.HALTED
    with pytest.raises(DdcmpError, match="expected a running line, got one that is halted"):
        end.send(b"b", NOW_S)


def test_after_a_restart_numbers_begin_anew() -> None:
    end = running()
    put(end, Data(1, 0, b"unread"))
    end.send(b"a", NOW_S)
    put(end, Strt())
    assert frames(end.start(NOW_S)) == [Strt()]
    assert end.failure is None
    assert put(end, Strt()) == [Stack()]
    assert put(end, Data(1, 0, b"new")) == [Ack(1)]
    assert read_all(end) == [b"new"]
    assert frames(end.send(b"a", NOW_S)) == [Data(1, 1, b"a")]


# --- misuse and hostile bytes


def test_nothing_can_be_sent_before_the_line_runs() -> None:
    end = Ddcmp()
    for act in (lambda: None, lambda: end.start(NOW_S)):
        act()
        with pytest.raises(DdcmpError, match="expected a running line"):
            end.send(b"a", NOW_S)


@pytest.mark.parametrize("length", (0, 513))
def test_a_message_that_fits_no_frame_is_refused(length: int) -> None:
    with pytest.raises(DdcmpError, match=f"expected 1 to 512 bytes, got {length}"):
        running().send(bytes(length), NOW_S)


@pytest.mark.parametrize(
    "make",
    [
        lambda: DdcmpSettings(window=256),
        lambda: DdcmpSettings(reply_timer_s=0),
        lambda: DdcmpSettings(max_message=0),
        lambda: DdcmpSettings(byte_s=float("nan")),
        lambda: DdcmpSettings(fill=b"\x00"),
    ],
)
def test_settings_out_of_range_are_refused(make: Callable[[], DdcmpSettings]) -> None:
    with pytest.raises(DdcmpError, match=r"^DDCMP: \w+: expected .* got "):
        make()


@given(st.lists(st.tuples(st.binary(max_size=80), st.floats(0, 5)), max_size=30))
def test_any_bytes_deliver_nothing_and_break_nothing(pieces: list[tuple[bytes, float]]) -> None:
    end, now_s = running(), NOW_S
    end.send(b"ours", now_s)
    for piece, pause_s in pieces:
        now_s += pause_s
        end.receive(piece, now_s)
        end.tick(now_s)
        assert end.read() is None
    assert end.state is State.RUNNING or end.failure is not None


@given(
    st.lists(
        st.sampled_from([Strt(), Stack(), Ack(0), Ack(1), Nak(1, 0), Nak(63, 1), Rep(0), Rep(9), Data(1, 0, b"one")])
        | st.builds(Data, st.integers(2, 255), st.integers(0, 255), st.just(b"other")),
        max_size=40,
    )
)
def test_any_frames_deliver_in_order_and_once(given: list[Sendable]) -> None:
    """Of a peer gone mad only what continues the sequence is taken."""
    end = Ddcmp()
    end.start(NOW_S)
    expected, got = 1, []
    for frame in given:
        end.receive(encode(frame), NOW_S)
        if isinstance(frame, Data) and end.state is State.RUNNING:
            while (message := end.read()) is not None:
                assert frame.number == expected % 256
                assert message == frame.payload
                expected += 1
                got.append(message)
    assert read_all(end) == []
    assert len(got) == expected - 1


Edit = tuple[str, int, int]
edits = st.tuples(st.sampled_from(["flip", "delete", "insert", "repeat"]), st.integers(0, 400), st.integers(1, 60))


def edited(stream: bytes, edit: Edit) -> bytes:
    """Return a stream that suffered one accident."""
    kind, place, size = edit
    at = place % len(stream) if stream else 0
    if kind == "flip" and stream:
        return stream[:at] + bytes([stream[at] ^ size]) + stream[at + 1 :]
    if kind == "delete":
        return stream[:at] + stream[at + size :]
    if kind == "insert":
        return stream[:at] + bytes(range(0x80, 0x80 + size)) + stream[at:]
    return stream[: at + size] + stream[at:]


@given(
    st.lists(st.text(st.characters(codec="ascii"), min_size=7, max_size=40), min_size=1, max_size=8),
    st.lists(edits, min_size=1, max_size=6),
    st.lists(st.integers(1, 60), min_size=1, max_size=20),
)
def test_whatever_happens_to_a_stream_what_is_delivered_was_sent(
    texts: list[str], accidents: list[Edit], lengths: list[int]
) -> None:
    sent = [text.encode() for text in texts]
    stream = b"".join(encode(Data(n, 0, text)) for n, text in enumerate(sent, 1))
    for accident in accidents:
        stream = edited(stream, accident)
    end, now_s, at = running(), NOW_S, 0
    while at < len(stream):
        length = lengths[at % len(lengths)]
        end.receive(stream[at : at + length], now_s)
        at, now_s = at + length, now_s + 0.01
    end.tick(now_s + 10.0)
    delivered = read_all(end)
    assert delivered == sent[: len(delivered)]
