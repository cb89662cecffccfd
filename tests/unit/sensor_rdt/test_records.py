"""Records by the byte, calibrations, and what is made of a stream."""

from __future__ import annotations

from itertools import pairwise

import pytest

from services.rules.mount import Mount
from services.sensor_rdt import calibration, records
from services.sensor_rdt.calibration import Calibration
from services.sensor_rdt.emulator.box import Box
from services.sensor_rdt.errors import CalibrationError, RebootedError
from services.sensor_rdt.records import LOST, SATURATED, Record
from services.sensor_rdt.stream import Stream
from services.wire.messages import FtPacket

MS = 1_000_000


@pytest.mark.parametrize(
    ("command", "count", "bytes_"),
    [
        # Head 1234, command, count: big-endian, also the count.
        (records.STREAM, 0, "1234000200000000"),
        (records.STREAM, 1, "1234000200000001"),
        (records.BIAS, 0, "1234004200000000"),
        (records.FILTER, 4, "1234008100000004"),
        (records.STOP, 0, "1234000000000000"),
    ],
)
def test_requests(command: int, count: int, bytes_: str) -> None:
    assert records.request(command, count).hex() == bytes_


def test_a_record_with_every_sign_bit_set() -> None:
    data = bytes.fromhex("80000001fffffff980020000" + "80000000ffffffff000000017ffffffffff0bdc0000f4240")
    assert records.record(data) == Record(
        0x80000001, 0xFFFFFFF9, 0x80020000, (-(2**31), -1, 1, 2**31 - 1, -1_000_000, 1_000_000)
    )
    assert records.record(data[:-1]) is None
    assert records.record(data + b"\0") is None


@pytest.mark.parametrize(
    ("status", "bits", "words"),
    [
        (0, 0, ""),
        (0x80020000, SATURATED, "saturated, or its converter fails"),
        (0x90000000, LOST, "analog board"),
        (0x80000000, LOST, "an error that it does not name"),
        (0xC0000000, LOST, "CPU or memory, or of an Axia saturated"),
        (0x80000002, LOST, "an error that it does not name"),  # an Axia's supply
        (0x90020000, SATURATED | LOST, "analog board, saturated, or its converter fails"),
        (0x00010000, 0, ""),  # a condition of the user's own is met: no trouble
    ],
)
def test_status(status: int, bits: int, words: str) -> None:
    assert records.status_of(status) == bits
    assert records.troubles(status) == words


def test_a_page_in_pounds_is_read_in_newton() -> None:
    made = calibration.from_page(Box(force_unit="lbf", torque_unit="lbf-in", per_force=1000, per_torque=500).page)
    (fx, _, _), (tx, _, _) = made.read((1000, 0, 0, 500, 0, 0))
    assert fx == pytest.approx(4.4482216152605)
    assert tx == pytest.approx(0.1129848290276)
    assert (made.serial, made.rate_hz) == ("FT00001", 7000.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((b"<scfgfu>N<", b"<scfgfu>stone<"), "expected a unit of force"),
        ((b"<scfgtu>N-m<", b"<scfgtu><"), "expected a unit of torque"),
        ((b"<cfgcpf>1000000<", b"<cfgcpf>0<"), "above 0"),
        ((b"<cfgcpf>1000000<", b"<cfgcpf>nan<"), "above 0"),
        ((b"cfgcpt>", b"other>"), "expected a number as cfgcpt"),
        ((b"</netft>", b""), "to be XML"),
    ],
)
def test_a_page_that_is_not_understood_is_refused(change: tuple[bytes, bytes], words: str) -> None:
    with pytest.raises(CalibrationError, match=words):
        calibration.from_page(Box().page.replace(*change))


# -- streams ----------------------------------------------------------------------------------------------------------


def stream(batch: int = 1) -> Stream:
    return Stream(Calibration(1000.0, 1000.0), Mount(), 1000.0, batch)


def fed(made: Stream, *numbers: int, first_ns: int = 10**18, status: int = 0) -> list[FtPacket]:
    """Return the packets for records with these numbers, a millisecond apart; the force is the number."""
    return [
        packet
        for place, number in enumerate(numbers)
        for packet in made.take(
            Record(number % 2**32, 7 * number % 2**32, status, (1000 * number, 0, 0, 0, 0, 0)), first_ns + place * MS
        )
    ]


def test_samples_are_batched_in_order() -> None:
    made = stream(batch=3)
    packets = fed(made, 1, 2, 3, 4, 5, 6, 7)
    assert [[force[0] for force in packet.force_n] for packet in packets] == [[1, 2, 3], [4, 5, 6]]
    assert packets[1].sequence - packets[0].sequence == 3
    assert packets[1].t_ns - packets[0].t_ns == 3 * MS
    assert [packet.force_n[0][0] for packet in made.flush()] == [7]


def test_lost_repeated_and_late_records_are_counted_and_never_pass_for_new() -> None:
    made = stream()
    packets = fed(made, 1, 2, 2, 5, 3, 4, 6)
    assert [packet.force_n[-1][0] for packet in packets] == [1, 2, 5, 6]
    assert (made.lost, made.repeated, made.late, made.taken) == (2, 1, 2, 4)
    first = packets[0].sequence
    assert [packet.sequence - first for packet in packets] == [0, 1, 4, 5]
    assert all(later.t_ns > earlier.t_ns for earlier, later in pairwise(packets))


def test_numbers_wrap() -> None:
    made = stream()
    fed(made, 2**32 - 2, 2**32 - 1, 2**32, 2**32 + 1)
    assert (made.lost, made.taken) == (0, 4)


def test_a_box_that_begins_anew_is_said() -> None:
    made = stream()
    fed(made, 5000, 5001)
    with pytest.raises(RebootedError, match="expected record 5002, got 1"):
        fed(made, 1)
    made.begin()
    assert [packet.force_n[0][0] for packet in fed(made, 1, first_ns=10**18 + 10**9)] == [1]


def test_a_record_that_waited_is_not_taken_for_a_later_one() -> None:
    made = stream()
    on_time = fed(made, 1, 2, 3)[-1]
    (waited,) = made.take(Record(4, 28, 0, (0,) * 6), 10**18 + 50 * MS)
    assert waited.t_ns - on_time.t_ns == MS


def test_a_status_goes_out_at_once_and_alone() -> None:
    made = stream(batch=10)
    assert fed(made, 1, 2) == []
    before, told = fed(made, 3, status=0x80020000)
    assert (before.status, len(before.force_n)) == (0, 2)
    assert (told.status, len(told.force_n)) == (SATURATED, 1)
