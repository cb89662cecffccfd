"""The terminal's machine, fed whole, byte by byte and with garbage: what it says, and what it never does."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.robot_link.emulator.arm import IdealArm
from services.robot_link.emulator.controller import LOAD, Behaviour, Controller
from services.robot_link.emulator.floppy import FloppyError
from services.robot_link.val2.dialects import DIALECTS
from services.robot_link.val2.terminal import Answer, Event, Greeted, State, Terminal, Trouble

MOVE = "DO MOVE HERE:TRANS(0,0,0.2,0,0,0)"
ABORT = b"\x15ABORT\r"
KNOCK = b"\x15?\r"


def idle(echo: bool = True) -> Terminal:
    """Return a terminal that has been greeted."""
    made = Terminal(DIALECTS["val2"], echo=echo)
    made.start(0.0)
    assert made.take() == KNOCK
    assert made.receive(b"\r\nVAL II\r\n.", 0.0) == []
    assert made.tick(1.0) == [Greeted(("VAL II",))]
    return made


def feed(terminal: Terminal, text: bytes, pieces: bool) -> list[Event]:
    if not pieces:
        return terminal.receive(text, 2.0)
    return [event for value in text for event in terminal.receive(bytes([value]), 2.0)]


def asked(terminal: Terminal, command: str, pieces: bool = False) -> None:
    terminal.ask(command, 1.0)
    assert terminal.take() == command.encode()
    assert feed(terminal, command.encode(), pieces) == []
    assert terminal.take() == b"\r"


@pytest.mark.parametrize("pieces", [False, True])
@pytest.mark.parametrize("end", [b"\r\n", b"\n", b"\r"])
def test_a_command_is_echoed_sent_off_and_answered(pieces: bool, end: bytes) -> None:
    terminal = idle()
    asked(terminal, "WHERE", pieces)
    shown = end + b" X Y Z" + end + b" 1.0 2.0" + end + b"."
    assert feed(terminal, shown, pieces) == [Answer("WHERE", (" X Y Z", " 1.0 2.0"), None)]
    assert terminal.state is State.IDLE


def test_blanks_and_a_prompt_after_the_prompt_do_no_harm() -> None:
    terminal = idle()
    asked(terminal, "WHERE")
    assert terminal.receive(b"\r\n.\r\n\r\n.\r\n", 2.0) == [Answer("WHERE", (), None)]
    asked(terminal, "WHERE")
    assert terminal.receive(b"\r\n.", 2.0) == [Answer("WHERE", (), None)]
    assert terminal.receive(b"\r\n.\r\n\x00", 2.0) == []
    asked(terminal, "STATUS")


def test_an_error_line_is_the_answer_and_a_lone_star_needs_silence() -> None:
    terminal = idle()
    asked(terminal, MOVE)
    assert terminal.receive(b"\r\n*Arm power off*\r\n.", 2.0) == [Answer(MOVE, ("*Arm power off*",), "*Arm power off*")]
    asked(terminal, "WHERE")
    assert terminal.receive(b"\r\n*", 3.0) == []
    assert terminal.tick(3.05) == []
    assert terminal.receive(b"busy*\r\n*", 3.06) == []
    assert terminal.tick(3.2) == [Answer("WHERE", ("*busy*",), "*busy*")]


def test_start_up_questions_are_answered_so_that_nothing_is_erased() -> None:
    terminal = Terminal(DIALECTS["val2"])
    terminal.start(0.0)
    terminal.take()
    terminal.receive(b"\r\nLoad VAL II from floppy (Y/N)? ", 0.1)
    assert terminal.take() == b"N\r"
    terminal.receive(b"N\r\nInitialize (Y/N)? ", 0.2)
    assert terminal.take() == b"N\r"
    assert terminal.receive(b"N\r\n.", 0.3) == []
    (greeted,) = terminal.tick(0.5)
    assert isinstance(greeted, Greeted)


def test_it_knocks_until_somebody_is_there() -> None:
    terminal = Terminal(DIALECTS["val2"])
    terminal.start(0.0)
    assert terminal.take() == KNOCK
    assert terminal.tick(0.5) == []
    assert terminal.take() == b""
    assert terminal.tick(1.1) == []
    assert terminal.take() == KNOCK


@pytest.mark.parametrize(
    ("heard", "reason"),
    [
        (b"DO MOVE HERE:TRANS(0,0,0.3", "expected the echo"),
        (b"DO MOVE HERE:TRANS(0,0,\xff", "expected the echo"),
        (b"*Unknown*", "expected the echo"),
    ],
)
def test_a_disturbed_command_is_never_sent_off(heard: bytes, reason: str) -> None:
    terminal = idle()
    terminal.ask(MOVE, 1.0)
    terminal.take()
    (trouble,) = terminal.receive(heard, 1.0)
    assert isinstance(trouble, Trouble)
    assert reason in trouble.reason
    assert terminal.take() == ABORT
    assert terminal.receive(b"anything\r\n.", 1.1) == []
    with pytest.raises(ValueError, match="expected to be idle"):
        terminal.ask("WHERE", 1.2)


@pytest.mark.parametrize("heard", [b"\r\n \x93\xfe", b"\r\n" + b"x" * 300, b"\r\n" + b"a\r\n" * 100])
def test_garbage_in_a_reply_ends_in_an_abort(heard: bytes) -> None:
    terminal = idle()
    asked(terminal, MOVE)
    (trouble,) = terminal.receive(heard, 2.0)
    assert isinstance(trouble, Trouble)
    assert terminal.take() == ABORT


@pytest.mark.parametrize("echoed", [False, True])
def test_silence_ends_in_an_abort(echoed: bool) -> None:
    terminal = idle()
    terminal.ask(MOVE, 1.0, 7.0)
    terminal.take()
    if echoed:
        assert terminal.receive(MOVE.encode(), 1.0) == []
        assert terminal.take() == b"\r"
        assert terminal.tick(7.9) == []
    assert terminal.tick(2.9) == []
    (trouble,) = terminal.tick(8.1)
    assert isinstance(trouble, Trouble)
    assert ("prompt" if echoed else "echo") in trouble.reason
    assert terminal.take() == ABORT


def test_what_is_said_unasked_is_a_trouble() -> None:
    terminal = idle()
    (trouble,) = terminal.receive(b"\r\n*Emergency stop*\r\n.", 2.0)
    assert isinstance(trouble, Trouble)
    assert "Emergency stop" in trouble.reason


@pytest.mark.parametrize("command", ["", "WHERE\r", "WH\x00ERE", " WHERE", "WH\u00c9RE"])
def test_only_one_line_of_text_can_be_asked(command: str) -> None:
    with pytest.raises(ValueError, match="printable"):
        idle().ask(command, 1.0)


def test_without_echo_a_command_is_sent_off_at_once() -> None:
    terminal = idle(echo=False)
    terminal.ask("WHERE", 1.0)
    assert terminal.take() == b"WHERE\r"
    assert terminal.receive(b"1 2 3\r\n.", 1.1) == [Answer("WHERE", ("1 2 3",), None)]


@settings(max_examples=300)
@given(st.lists(st.one_of(st.binary(max_size=20), st.sampled_from([b"\r\n.", b".", b"*", b"\r\n", MOVE.encode()]))))
def test_no_bytes_crash_it_or_send_a_motion_off_that_was_not_echoed(pieces: list[bytes]) -> None:
    terminal = idle()
    terminal.ask(MOVE, 1.0)
    heard, now_s = b"", 1.0
    for piece in pieces:
        heard += piece
        now_s += 0.3
        terminal.receive(piece, now_s)
        terminal.tick(now_s)
    sent = terminal.take()
    if b"\r" in sent.replace(ABORT, b""):
        clean = bytes(value for value in heard if value not in b"\r\n\x00\x7f")
        assert clean.startswith(MOVE.encode())
    assert sent.count(MOVE.encode()) == 1


@settings(max_examples=200)
@given(st.lists(st.binary(max_size=30)))
def test_nothing_but_knocks_and_answers_goes_out_before_a_greeting(pieces: list[bytes]) -> None:
    terminal = Terminal(DIALECTS["val2"])
    terminal.start(0.0)
    now_s = 0.0
    for piece in pieces:
        now_s += 0.05
        for event in terminal.receive(piece, now_s) + terminal.tick(now_s):
            assert isinstance(event, Greeted | Trouble)
    assert set(terminal.take().replace(ABORT, b"").replace(KNOCK, b"")) <= set(b"\rN")


def test_a_motion_typed_before_a_crash_is_not_carried_out_by_the_next_connection() -> None:
    controller = Controller(IdealArm(np.eye(4)))
    controller.receive(MOVE.encode(), 0.0)
    anew = Terminal(DIALECTS["val2"])
    anew.start(1.0)
    controller.receive(anew.take(), 1.0)
    assert controller.motions == 0
    controller.receive(MOVE.encode() + b"\r", 2.0)
    assert controller.motions == 1, "the same line, ended, is carried out"


def test_a_cold_controller_loads_its_system_from_a_floppy() -> None:
    def no_drive() -> str:
        raise FloppyError("drive: expected an answer within 10 s, got none")

    cold = Behaviour(cold=True)
    controller = Controller(IdealArm(np.eye(4)), cold, boot=no_drive)
    assert controller.start(0.0).endswith(LOAD.encode())
    refused = controller.receive(b"Y\r", 0.1).decode()
    assert refused.endswith(f"*drive: expected an answer within 10 s, got none*\r\n{LOAD}"), "and it asks again"
    controller.boot = lambda: "VAL II SYSTEM"
    assert controller.receive(b"Y\r", 0.2).endswith(b"\r\nVAL II SYSTEM\r\nInitialize (Y/N)? ")
    assert controller.receive(b"N\r", 0.3).endswith(b"\r\n.")
    without = Controller(IdealArm(np.eye(4)), cold, boot=no_drive)
    without.start(0.0)
    assert without.receive(b"N\r", 0.1).endswith(b"\r\nInitialize (Y/N)? "), "N leaves the disk alone"
