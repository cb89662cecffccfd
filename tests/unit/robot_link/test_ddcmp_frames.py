"""DDCMP frames: golden vectors both ways, whole, byte by byte and in bad company; misprints; hostile bytes."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.robot_link.ddcmp.crc16 import crc16, with_crc
from services.robot_link.ddcmp.frames import (
    QUICK_SYNC_AND_SELECT,
    Ack,
    Data,
    Decoder,
    Fault,
    Maintenance,
    Nak,
    Reason,
    Received,
    Rep,
    Sendable,
    Stack,
    Strt,
    encode,
)
from services.robot_link.emulator.supervisory_line import remainder, sealed

# STRT, STACK, ACK 0, ACK 1 and DATA are those of the thesis, appendix E.3, two of them without its misprints; the
# others are arithmetic that was checked against another implementation of the protocol.
BOTH, NONE = QUICK_SYNC_AND_SELECT, 0
READ = bytes.fromhex("02 02 00 00")
GOLDEN: list[tuple[str, Sendable, int]] = [
    ("05 06 C0 00 00 01 75 95", Strt(), BOTH),
    ("05 07 C0 00 00 01 48 55", Stack(), BOTH),
    ("05 01 C0 00 00 01 C0 55", Ack(0), BOTH),
    ("05 01 C0 01 00 01 91 95", Ack(1), BOTH),
    ("05 01 C0 02 00 01 61 95", Ack(2), BOTH),
    ("05 01 C0 FF 00 01 F0 65", Ack(255), BOTH),
    ("05 01 00 00 00 01 FC 55", Ack(0), NONE),
    ("05 01 00 01 00 01 AD 95", Ack(1), NONE),
    ("05 02 C1 00 00 01 85 A9", Nak(Reason.HEADER_CRC, 0), BOTH),
    ("05 02 01 00 00 01 B9 A9", Nak(Reason.HEADER_CRC, 0), NONE),
    ("05 02 C2 00 00 01 85 ED", Nak(Reason.DATA_CRC, 0), BOTH),
    ("05 02 02 00 00 01 B9 ED", Nak(Reason.DATA_CRC, 0), NONE),
    ("05 02 03 00 00 01 B8 11", Nak(Reason.REPLY, 0), NONE),
    ("05 02 08 01 00 01 EB F5", Nak(Reason.NO_BUFFER, 1), NONE),
    ("05 02 10 01 00 01 ED 55", Nak(Reason.TOO_LONG, 1), NONE),
    ("05 02 11 01 00 01 EC A9", Nak(Reason.HEADER_FORMAT, 1), NONE),
    ("05 03 C0 00 01 01 B8 05", Rep(1), BOTH),
    ("05 03 00 00 01 01 84 05", Rep(1), NONE),
    ("81 04 C0 00 01 01 13 81 02 02 00 00 A0 78", Data(1, 0, READ), BOTH),
    ("81 04 C0 01 01 01 42 41 02 02 00 00 A0 78", Data(1, 1, READ), BOTH),
    ("81 04 C0 01 02 01 42 B1 02 02 00 00 A0 78", Data(2, 1, READ), BOTH),
]
LONG = bytes.fromhex("81 00 C2 00 01 01 E3 F9")
"""Header of 512 bytes: the count goes on in byte 2."""
# As printed in the thesis; the CRCs fit other bytes, or none.
MISPRINTS = ("05 05 C0 00 00 01 75 95", "05 07 C0 00 00 01 46 55")
IDS = [text for text, _, _ in GOLDEN]
NEXT = Rep(9)
payloads = st.binary(min_size=1, max_size=40)


def decode(*pieces: bytes) -> list[Received]:
    """Return what a decoder that is in step makes of bytes."""
    decoder = Decoder()
    assert decoder.feed(encode(NEXT)) == [NEXT]
    return [frame for piece in pieces for frame in decoder.feed(piece)]


def single_bytes(data: bytes) -> list[bytes]:
    return [bytes([byte]) for byte in data]


def test_crc_check_value() -> None:
    assert crc16(b"123456789") == 0xBB3D == remainder(b"123456789")


@given(st.binary(max_size=600))
def test_both_ends_compute_the_same_crc(data: bytes) -> None:
    assert with_crc(data) == sealed(data)
    assert crc16(with_crc(data)) == 0 == remainder(with_crc(data))


@pytest.mark.parametrize(("text", "frame", "flags"), GOLDEN, ids=IDS)
def test_golden_vector_is_sent(text: str, frame: Sendable, flags: int) -> None:
    assert encode(frame, flags) == bytes.fromhex(text)


@pytest.mark.parametrize(("text", "frame", "flags"), GOLDEN, ids=IDS)
def test_golden_vector_is_understood(text: str, frame: Sendable, flags: int) -> None:
    data = bytes.fromhex(text)
    assert decode(data) == [frame]
    assert decode(*single_bytes(data)) == [frame]
    for fill in (b"\xff\xff", b"\x96\x96\x96\x96", b"\xff\x96" * 20):
        assert decode(fill + data + fill + data + fill) == [frame, frame]


@pytest.mark.parametrize(("text", "frame", "flags"), GOLDEN, ids=IDS)
def test_golden_vector_before_other_bytes(text: str, frame: Sendable, flags: int) -> None:
    data = bytes.fromhex(text)
    assert decode(data + b"\x05\x01") == [frame]
    assert decode(data + b"no frame" + encode(NEXT)) == [frame, Fault(Reason.HEADER_CRC), NEXT]
    assert decode(*single_bytes(data + b"\x81\x05\x90" + encode(NEXT))) == [frame, Fault(Reason.HEADER_CRC), NEXT]


def test_golden_header_of_a_long_message() -> None:
    payload = bytes(512)
    assert encode(Data(1, 0, payload)) == LONG + with_crc(payload)
    assert decode(*single_bytes(LONG + with_crc(payload))) == [Data(1, 0, payload)]


@pytest.mark.parametrize("count", (1, 255, 256, 8191, 8192, 16383))
def test_lengths_need_all_fourteen_bits(count: int) -> None:
    frame = Data(1, 0, bytes(count))
    assert Decoder(max_message=16383).feed(encode(frame)) == [frame]


@pytest.mark.parametrize("text", MISPRINTS)
def test_a_misprint_is_no_frame_and_hides_none(text: str) -> None:
    data = bytes.fromhex(text)
    assert decode(data + encode(NEXT)) == [Fault(Reason.HEADER_CRC), NEXT]
    assert decode(*single_bytes(data + encode(NEXT))) == [Fault(Reason.HEADER_CRC), NEXT]


def test_the_misprinted_type_is_none_even_with_a_good_crc() -> None:
    data = bytes.fromhex("05 05 C0 00 00 01 31 95")
    assert crc16(data) == 0
    assert decode(data + encode(NEXT)) == [Fault(Reason.HEADER_FORMAT), NEXT]


@pytest.mark.parametrize("byte", (0x81, 0x05, 0x90))
def test_a_false_start_does_not_swallow_the_frame_after_it(byte: int) -> None:
    for length in range(1, 8):
        assert decode(bytes([byte]) * length + encode(Ack(3)))[-1] == Ack(3)


def test_bad_payload_keeps_what_its_header_acknowledges() -> None:
    data = bytearray(encode(Data(4, 7, b"text")))
    data[10] ^= 1
    assert decode(bytes(data) + encode(NEXT)) == [Fault(Reason.DATA_CRC, 7), NEXT]


def test_a_message_that_is_too_long_is_skipped_in_pieces() -> None:
    data = encode(Data(4, 7, bytes(513)))
    assert decode(*single_bytes(data), encode(NEXT)) == [Fault(Reason.TOO_LONG, 7), NEXT]


@pytest.mark.parametrize(
    ("header", "body", "fault"),
    [
        ("81 04 C0 07 01 02", b"text", Fault(Reason.HEADER_FORMAT, 7)),  # another station's address
        ("81 00 C0 07 01 01", b"", Fault(Reason.HEADER_FORMAT, 7)),  # nothing in it
        ("05 01 C0 07 00 03", None, Fault(Reason.HEADER_FORMAT)),
        ("05 08 C0 00 00 01", None, Fault(Reason.HEADER_FORMAT)),
    ],
)
def test_headers_of_wrong_form(header: str, body: bytes | None, fault: Fault) -> None:
    data = with_crc(bytes.fromhex(header)) + (with_crc(body) if body is not None else b"")
    assert decode(data + encode(NEXT)) == [fault, NEXT]


def test_maintenance_frames_are_recognised() -> None:
    data = with_crc(bytes.fromhex("90 04 C0 00 00 01")) + with_crc(b"boot")
    assert decode(data + encode(NEXT)) == [Maintenance(b"boot"), NEXT]
    assert decode(*single_bytes(data)) == [Maintenance(b"boot")]
    data = data[:-1] + bytes([data[-1] ^ 1])
    assert decode(data + encode(NEXT)) == [Fault(Reason.DATA_CRC), NEXT]


@pytest.mark.parametrize("count", (0, 16384))
def test_what_fits_no_frame_is_not_encoded(count: int) -> None:
    with pytest.raises(ValueError, match=f"expected 1 to 16383 bytes, got {count}"):
        encode(Data(1, 0, bytes(count)))


@pytest.mark.parametrize("length", range(1, len(encode(Data(1, 5, b"text")))))
def test_a_frame_cut_short_can_be_given_up(length: int) -> None:
    decoder = Decoder()
    decoder.feed(encode(NEXT) + encode(Data(1, 5, b"text"))[:length])
    assert decoder.busy
    assert decoder.give_up() == [Fault(Reason.HEADER_CRC) if length < 8 else Fault(Reason.DATA_CRC, 5)]
    assert not decoder.busy
    assert decoder.feed(encode(NEXT)) == [NEXT]


@given(st.lists(st.binary(max_size=60)), st.lists(st.sampled_from([encode(NEXT), encode(Data(1, 5, b"text"))])))
def test_any_bytes_leave_a_decoder_that_finds_the_next_frame(pieces: list[bytes], frames: list[bytes]) -> None:
    decoder = Decoder(max_message=64)
    for piece in (*pieces, *frames):
        decoder.feed(piece)
    decoder.give_up()
    assert not decoder.busy
    assert decoder.feed(encode(Ack(77))) == [Ack(77)]


@given(payloads, st.integers(0, 255), st.integers(0, 255), st.lists(st.integers(0, 60), max_size=5))
def test_pieces_do_not_matter(payload: bytes, number: int, response: int, cuts: list[int]) -> None:
    frames: list[Received] = [Data(number, response, payload), Nak(Reason.OVERRUN, response), Rep(number)]
    data = b"".join(encode(frame) for frame in frames if not isinstance(frame, Fault | Maintenance))
    edges = [0, *sorted(cuts), len(data)]
    assert decode(*(data[first:last] for first, last in pairwise(edges))) == frames


@given(payloads, st.data())
def test_one_wrong_bit_is_always_noticed(payload: bytes, data: st.DataObject) -> None:
    sent = Data(3, 2, payload)
    stream = bytearray(encode(sent))
    place = data.draw(st.integers(0, 8 * len(stream) - 1))
    stream[place // 8] ^= 1 << place % 8
    decoder = Decoder()
    found = [*decoder.feed(encode(NEXT) + bytes(stream)), *decoder.give_up()]
    assert not [frame for frame in found[1:] if not isinstance(frame, Fault)]
    assert found[1:]
