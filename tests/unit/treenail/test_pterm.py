"""The pure parts of pterm: keys, screen, prompts, scripts. Time is given."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from treenail.tools.pterm.prompt import PromptWatch
from treenail.tools.pterm.script import Script
from treenail.tools.pterm.text import EchoFilter, Keyboard, Screen


def test_keys_are_sent_as_set_and_the_quit_key_ends() -> None:
    keys = Keyboard(b"\r\n", b"\b")
    assert keys.keys(b"a\rb\nc\x7f\x03\x1b") == (b"a\r\nb\r\nc\b\x03\x1b", False)
    assert keys.keys(b"ab\x1dcd") == (b"ab", True)
    assert Keyboard(b"\r").keys(b"\x7f") == (b"\x7f", False)


@pytest.mark.parametrize(
    ("came", "shown"),
    [
        (b"a\r\nb\rc\nd\n\re", "a\nb\nc\nd\n\ne"),
        (b"\xff\x00a\x7f\r\x00\nb", "a\nb"),
        (b"\x1b[2J\x8d\x07\x08\t", "<1B>[2J<8D>\a\b\t"),
    ],
)
def test_what_comes_is_shown_however_it_is_cut(came: bytes, shown: str) -> None:
    assert Screen().show(came) == shown
    screen = Screen()
    assert "".join(screen.show(bytes((byte,))) for byte in came) == shown


@given(st.binary())
def test_nothing_from_the_line_commands_the_terminal(came: bytes) -> None:
    assert all(one in "\n\a\b\t" or one.isprintable() for one in Screen().show(came))


def test_the_echo_of_an_edited_line_is_shown_once() -> None:
    echo = EchoFilter()
    echo.sent("WHERE\n")
    assert echo.show("WHE") + echo.show("RE\nX 1\n.") == "X 1\n."
    echo.sent("HERE\n")
    assert echo.show("HELLO\n") == "LLO\n"
    assert echo.show("RE\n") == "RE\n"


def watch(text: str) -> PromptWatch:
    made = PromptWatch(0.25)
    made.sent()
    made.received(text, 1.0)
    return made


@pytest.mark.parametrize("text", ["WHERE\n.", "\n. ", "x\n*", "INIT\nINITIALIZE (Y/N)? ", "HERE A\nX 1\nCHANGES?\n?"])
def test_a_prompt_stands_alone_and_then_silence(text: str) -> None:
    assert watch(text).ready_s() == 1.25


@pytest.mark.parametrize("text", ["", ".", "*", "WHERE", "\n*Location out", "\n.5", "\nhalf a line", "a\n.\n"])
def test_what_is_no_prompt(text: str) -> None:
    assert watch(text).ready_s() is None


def test_a_star_may_still_become_a_message() -> None:
    made = watch("DO MOVE A\n*")
    assert made.ready_s() == 1.25
    made.received("Location out of range*\n.", 1.1)
    assert made.ready_s() == 1.35
    assert made.error == "*Location out of range*"
    made.sent()
    assert made.ready_s() is None
    assert not made.error


def test_the_echo_of_a_line_is_no_error() -> None:
    assert watch("*A*\nfine\n.").error is None


def script(*lines: str, keep_going: bool = False) -> Script:
    made = Script(PromptWatch(0.25), 10.0, keep_going)
    for line in lines:
        made.add(line)
    made.close()
    return made


def test_each_line_waits_for_the_prompt_of_the_last() -> None:
    lines = script("A", "B")
    assert lines.next(0.0) == "A"
    assert lines.next_s() == 10.0
    assert lines.next(9.0) is None
    lines.received("A\nfine\n.", 9.0)
    assert lines.next_s() == 9.25
    assert lines.next(9.2) is None
    assert lines.next(9.25) == "B"
    lines.received("B\n.", 9.5)
    assert not lines.done
    assert lines.next(9.75) is None
    assert (lines.done, lines.failure, lines.next_s()) == (True, None, None)


def test_without_a_prompt_the_rest_is_not_sent() -> None:
    lines = script("A", "B", "C")
    lines.next(0.0)
    assert lines.next(10.0) is None
    assert lines.failure == "no prompt within 10 s after line 1 ('A'); 2 more not sent"
    lines.received("\n.", 11.0)
    assert lines.next(20.0) is None
    assert lines.done


@pytest.mark.parametrize("keep_going", [False, True])
def test_an_error_stops_a_script_unless_told_otherwise(keep_going: bool) -> None:
    lines = script("A", "B", keep_going=keep_going)
    lines.next(0.0)
    lines.received("A\n*Bad*\n.", 0.0)
    assert lines.next(1.0) == ("B" if keep_going else None)
    assert lines.failure == (None if keep_going else "the controller says '*Bad*' after line 1 ('A'); 1 more not sent")


def test_nothing_is_sent_again_after_a_lost_line() -> None:
    lines = script("DO MOVE A", "B")
    lines.next(0.0)
    lines.lost()
    assert lines.failure == "the line was lost after line 1 ('DO MOVE A'); 1 more not sent"
    assert lines.next(99.0) is None
    calm = script()
    calm.lost()
    assert calm.failure is None
