"""TU58's Radial Serial Protocol: golden vectors both ways, the drive's every answer, hostile bytes."""

from __future__ import annotations

from collections.abc import Iterable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.robot_link.emulator.floppy import ones_sum
from tests.unit.treenail.drives import said
from treenail.tools.pfloppy.disk_errors import DamageError, MissingError, ProtectedError
from treenail.tools.pfloppy.tu58 import (
    Control,
    Flag,
    Modifier,
    Opcode,
    Success,
    Switch,
    checksum,
    control_of,
    message_of,
    packet,
)
from treenail.tools.pfloppy.tu58_drive import Tu58Drive

SIZE = 512 * 512
CONTENT = bytes(byte * 7 % 251 for byte in range(SIZE))
# Arithmetic by hand from the protocol's description; the two ENDs differ in whether the carry wraps.
CONTROLS = {
    "02 0A 00 00 00 00 00 00 00 00 00 00 02 0A": Control(Opcode.NOP),
    "02 0A 01 00 00 00 00 00 00 00 00 00 03 0A": Control(Opcode.INIT),
    "02 0A 02 00 00 00 00 00 00 02 00 00 04 0C": Control(Opcode.READ, count=512),
    "02 0A 02 00 01 00 00 00 00 04 05 00 0A 0E": Control(Opcode.READ, unit=1, count=1024, block=5),
    "02 0A 03 00 00 00 00 00 80 00 01 00 86 0A": Control(Opcode.WRITE, count=128, block=1),
    "02 0A 05 00 00 00 00 00 00 00 FF 01 06 0C": Control(Opcode.POSITION, block=511),
    "02 0A 40 00 00 00 00 00 00 02 00 00 42 0C": Control(Opcode.END, count=512),
    "02 0A 40 F8 00 00 00 00 00 00 00 00 43 02": Control(Opcode.END, Success.BAD_UNIT),
    "02 0A 40 C9 00 00 00 00 00 00 00 00 42 D3": Control(Opcode.END, Success.BAD_BLOCK),
}
DATA = {
    "01 03 41 42 43 85 45": b"ABC",
    "01 80 " + "00 " * 128 + "01 80": bytes(128),
    "01 80 " + "FF " * 128 + "01 80": b"\xff" * 128,
    "01 80 " + " ".join(f"{byte:02X}" for byte in range(128)) + " D1 8F": bytes(range(128)),
}
CONTINUE, INIT = b"\x10", b"\x04"
NOP = Control(Opcode.NOP).encode()
GOOD = Control(Opcode.END).encode()


class Memory:
    """A disk that remembers what it was asked."""

    size = SIZE

    def __init__(self, failure: Exception | None = None) -> None:
        self.content = bytearray(CONTENT)
        self.writes: list[tuple[int, bytes]] = []
        self.failure, self.forgets = failure, False

    def read(self, offset: int, count: int) -> bytes:
        if self.failure is not None:
            raise self.failure
        return bytes(self.content[offset : offset + count])

    read_back = read

    def boot(self) -> bytes:
        return self.read(0, 512)

    def write(self, offset: int, data: bytes) -> None:
        if self.failure is not None:
            raise self.failure
        self.writes.append((offset, data))
        if not self.forgets:
            self.content[offset : offset + len(data)] = data


def drive(*disks: Memory) -> Tu58Drive:
    return Tu58Drive(disks)


def answers(machine: Tu58Drive, pieces: Iterable[bytes]) -> bytes:
    """Return all that a drive says to what comes in pieces."""
    return b"".join(said(machine, piece) for piece in pieces)


def ask(machine: Tu58Drive, *pieces: bytes) -> bytes:
    return answers(machine, pieces)


def end(success: int = 0, count: int = 0, unit: int = 0) -> bytes:
    return Control(Opcode.END, success, unit, count=count).encode()


@pytest.mark.parametrize(("vector", "control"), CONTROLS.items())
def test_a_control_packet_is_its_bytes(vector: str, control: Control) -> None:
    whole = bytes.fromhex(vector)
    assert control.encode() == whole
    message = message_of(whole)
    assert message is not None
    assert control_of(message) == control


@pytest.mark.parametrize(("vector", "content"), DATA.items(), ids=lambda one: str(one)[:20])
def test_a_data_packet_is_its_bytes(vector: str, content: bytes) -> None:
    whole = bytes.fromhex(vector)
    assert packet(Flag.DATA, content) == whole
    assert message_of(whole) == content


@pytest.mark.parametrize("vector", [*CONTROLS, *DATA], ids=lambda one: one[:20])
def test_any_changed_byte_is_noticed(vector: str) -> None:
    whole = bytes.fromhex(vector)
    for at in range(len(whole)):
        wrong = bytearray(whole)
        wrong[at] ^= 0x55
        assert message_of(bytes(wrong)) is None
    assert message_of(whole + b"\0") is None
    assert message_of(whole[:-1]) is None


@given(st.binary(max_size=300))
def test_both_sides_compute_the_same_checksum(data: bytes) -> None:
    assert checksum(data) == ones_sum(data)
    assert 0 <= checksum(data) <= 0xFFFF


COMMANDS = [vector for vector, control in CONTROLS.items() if control.opcode not in (Opcode.END, Opcode.WRITE)]


@pytest.mark.parametrize("vector", COMMANDS)
def test_bytes_may_come_as_they_like(vector: str) -> None:
    whole = bytes.fromhex(vector)
    expected = ask(drive(Memory(), Memory()), whole)
    assert expected[-14:-12] == b"\x02\x0a"
    assert ask(drive(Memory(), Memory()), *(bytes((byte,)) for byte in whole)) == expected
    assert ask(drive(Memory(), Memory()), whole + NOP) == GOOD  # a new command gives up what has not been sent yet
    assert ask(drive(Memory(), Memory()), whole, NOP) == expected + GOOD
    assert ask(drive(Memory(), Memory()), whole + whole[:5]) == expected


@pytest.mark.parametrize("opcode", [Opcode.NOP, Opcode.INIT, Opcode.DIAGNOSE, Opcode.GET_STATUS, Opcode.SET_STATUS, 10])
def test_what_is_done_at_once(opcode: int) -> None:
    assert ask(drive(Memory()), Control(opcode).encode()) == end()


@pytest.mark.parametrize("opcode", [4, 6, 11, 0x40, 0xFF])
def test_other_operations_are_refused(opcode: int) -> None:
    assert ask(drive(Memory()), Control(opcode).encode()) == end(Success.BAD_OPCODE)


def test_power_up_calls_until_spoken_to() -> None:
    machine = drive(Memory())
    for _ in range(3):
        assert machine.transmit() == INIT
        assert machine.transmit() == b""
        machine.silence()
    assert ask(machine, b"\0" + INIT) == b""
    machine.silence()
    assert machine.transmit() == b""
    assert ask(machine, INIT) == CONTINUE
    machine.silence()
    assert machine.transmit() == b""


def test_a_break_and_two_inits_stop_anything() -> None:
    disk = Memory()
    machine = drive(disk)
    machine.receive(Control(Opcode.READ, count=60000).encode())
    assert machine.transmit()[0] == Flag.DATA
    assert ask(machine, b"\0\x04\x04") == CONTINUE
    assert ask(machine, Control(Opcode.WRITE, count=256, block=9).encode()) == CONTINUE
    assert ask(machine, packet(Flag.DATA, bytes(128))) == CONTINUE
    assert ask(machine, b"\0\x04\x04", NOP) == CONTINUE + GOOD
    assert disk.writes == []


def test_read_gives_packets_of_128_and_an_end() -> None:
    disk = Memory()
    expected = b"".join(packet(Flag.DATA, bytes(disk.content[at : at + 128])) for at in (2560, 2688))
    expected += packet(Flag.DATA, bytes(disk.content[2816:2860])) + end(count=300)
    assert ask(drive(disk), Control(Opcode.READ, count=300, block=5).encode()) == expected


def test_records_of_128_are_addressed_one_by_one() -> None:
    disk = Memory()
    read = Control(Opcode.READ, Modifier.RECORDS, count=128, block=2047).encode()
    assert ask(drive(disk), read) == packet(Flag.DATA, bytes(disk.content[-128:])) + end(count=128)
    write = Control(Opcode.WRITE, Modifier.RECORDS, count=3, block=7).encode()
    assert ask(drive(disk), write, packet(Flag.DATA, b"abc")) == CONTINUE + end(count=3)
    assert disk.writes == [(7 * 128, b"abc".ljust(128, b"\0"))]


def test_write_asks_for_each_packet_and_fills_the_block() -> None:
    disk, data = Memory(), bytes(range(200))
    machine = drive(disk)
    assert ask(machine, Control(Opcode.WRITE, count=200, block=3).encode()) == CONTINUE
    assert ask(machine, packet(Flag.DATA, data[:128])) == CONTINUE
    assert disk.writes == []
    assert ask(machine, packet(Flag.DATA, data[128:])) == end(count=200)
    assert disk.writes == [(1536, data.ljust(512, b"\0"))]


@pytest.mark.parametrize("opcode", [Opcode.READ, Opcode.WRITE, Opcode.POSITION])
def test_units_and_blocks_that_are_not_there(opcode: Opcode) -> None:
    assert ask(drive(Memory()), Control(opcode, unit=1, count=1).encode()) == end(Success.BAD_UNIT, unit=1)
    assert ask(drive(Memory()), Control(opcode, block=512, count=1).encode()) == end(Success.BAD_BLOCK)
    records = Control(opcode, Modifier.RECORDS, block=2048, count=1).encode()
    assert ask(drive(Memory()), records) == end(Success.BAD_BLOCK)


def test_past_the_end_of_the_medium_is_partial() -> None:
    disk = Memory()
    said = ask(drive(disk), Control(Opcode.READ, count=1024, block=511).encode())
    assert said.endswith(end(Success.PARTIAL, 512))
    assert len(said) == 4 * 132 + 14
    write = Control(Opcode.WRITE, Modifier.RECORDS, count=256, block=2047).encode()
    assert ask(drive(disk), write, packet(Flag.DATA, bytes(128))) == CONTINUE + end(Success.PARTIAL, 128)
    assert disk.writes == [(SIZE - 128, bytes(128))]


@pytest.mark.parametrize(
    ("failure", "code"),
    [
        (ProtectedError("no"), Success.WRITE_PROTECTED),
        (DamageError("no"), Success.DATA_CHECK),
        (MissingError("no"), Success.NO_CARTRIDGE),
    ],
)
def test_a_disk_that_refuses_is_told_on(failure: Exception, code: Success) -> None:
    write = Control(Opcode.WRITE, count=1, block=3).encode()
    assert ask(drive(Memory(failure)), write, packet(Flag.DATA, b"a")) == CONTINUE + end(code)


def test_a_disk_that_cannot_be_read_is_told_on() -> None:
    assert ask(drive(Memory(DamageError("no"))), Control(Opcode.READ, count=1).encode()) == end(Success.DATA_CHECK)
    assert ask(drive(Memory(DamageError("no"))), b"\x08\x00") == INIT


@pytest.mark.parametrize("forgets", [False, True])
def test_verify_compares(forgets: bool) -> None:
    disk = Memory()
    disk.forgets = forgets
    write = Control(Opcode.WRITE, Modifier.VERIFY, count=1, block=3).encode()
    expected = end(Success.DATA_CHECK) if forgets else end(count=1)
    assert ask(drive(disk), write, packet(Flag.DATA, b"a")) == CONTINUE + expected


def test_boot_is_block_0_without_a_packet() -> None:
    disk = Memory()
    assert ask(drive(disk), b"\x08\x00") == bytes(disk.content[:512])
    assert ask(drive(disk), b"\x08\x01") == INIT


def test_mrsp_sends_a_byte_for_each_continue() -> None:
    command = Control(Opcode.READ, switches=Switch.MRSP, count=3).encode()
    plain = ask(drive(Memory()), Control(Opcode.READ, count=3).encode())
    machine = drive(Memory())
    said = ask(machine, command)
    assert said == plain[:1]
    while more := ask(machine, CONTINUE):
        assert len(more) == 1
        said += more
    assert said == plain


def test_xoff_holds_the_next_packet_until_continue_or_xon() -> None:
    machine = drive(Memory())
    machine.receive(Control(Opcode.READ, count=256).encode())
    for go_on in (CONTINUE, b"\x11"):
        assert machine.transmit()[0] == Flag.DATA
        machine.receive(b"\x13")
        assert machine.transmit() == b""
        machine.receive(go_on)
    assert machine.transmit() == end(count=256)


def test_a_wrong_checksum_is_a_data_check_and_writes_nothing() -> None:
    disk = Memory()
    assert ask(drive(disk), NOP[:-1] + b"\xff") == end(Success.DATA_CHECK)
    wrong = packet(Flag.DATA, b"abc")[:-1] + b"\x00"
    machine = drive(disk)
    said = ask(machine, Control(Opcode.WRITE, count=3, block=5).encode(), wrong, NOP)
    assert said == CONTINUE + end(Success.DATA_CHECK) + GOOD
    too_much = ask(machine, Control(Opcode.WRITE, count=3, block=5).encode(), packet(Flag.DATA, b"abcd"))
    assert too_much == CONTINUE + end(Success.DATA_CHECK)
    assert disk.writes == []


@pytest.mark.parametrize("garbage", [b"\x55", b"\x02\x0b", b"\x01\x03", b"\xff\xff\xff"])
def test_what_is_no_packet_makes_the_drive_call(garbage: bytes) -> None:
    machine = drive(Memory())
    assert ask(machine, garbage)[:1] == INIT
    assert ask(machine, b"\0\x04\x04", NOP).endswith(CONTINUE + GOOD)


def test_a_packet_that_does_not_go_on_is_given_up() -> None:
    machine = drive(Memory())
    assert ask(machine, NOP[:9]) == b""
    machine.silence()
    assert machine.transmit() == INIT
    assert ask(machine, b"\0\x04\x04", NOP) == CONTINUE + GOOD


def test_a_new_command_gives_up_an_unfinished_write() -> None:
    disk = Memory()
    machine = drive(disk)
    assert ask(machine, Control(Opcode.WRITE, count=256, block=9).encode(), packet(Flag.DATA, bytes(128)), NOP) == (
        CONTINUE * 2 + GOOD
    )
    assert ask(machine, packet(Flag.DATA, bytes(128))) == INIT
    assert disk.writes == []


@settings(max_examples=300)
@given(
    st.lists(
        st.one_of(
            st.binary(max_size=40),
            st.builds(lambda *one: Control(*one).encode(), *[st.integers(0, 255)] * 4, *[st.integers(0, 65535)] * 3),
            st.builds(packet, st.just(1), st.binary(max_size=128)),
            st.sampled_from([b"\x04\x04", b"\x10", b"\x13", b"\x08\x00"]),
        ),
        max_size=12,
    )
)
def test_hostile_bytes_never_break_it(pieces: list[bytes]) -> None:
    machine = drive(Memory())
    for piece in pieces:
        machine.receive(piece)
        machine.transmit()
        machine.silence()
    said = ask(machine, b"\0\x04\x04", b"\0" * 140, b"\0\x04\x04")
    assert said.endswith(CONTINUE)
    assert ask(machine, NOP) == GOOD
