"""Text from elsewhere is read as what it says, or becomes one printable line."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.wire.text import decode, number, numbers, one_line, whole


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", ""),
        ("plain \N{DEGREE SIGN}", "plain \N{DEGREE SIGN}"),
        ("two\nlines\r", "two?lines?"),
        ("\x1b[2J", "?[2J"),
        ("\u202eback", "?back"),
        ("\ud800", "?"),
        ("abcdefgh", "abcdefgh"),
        ("abcdefghi", "abcde..."),
    ],
)
def test_what_is_not_printable_is_marked_and_what_is_long_is_cut(text: str, line: str) -> None:
    assert one_line(text, 8 if text.startswith("abc") else 300) == line


@given(st.text(), st.integers(4, 40))
def test_any_text_becomes_one_printable_line(text: str, most: int) -> None:
    line = one_line(text, most)
    assert line.isprintable()
    assert len(line) == min(len(text), most)
    assert one_line(line, most) == line


@pytest.mark.parametrize(("text", "value"), [("-1.5", -1.5), ("+2e3", 2000.0), (".5", 0.5), ("7.", 7.0), (" 0 ", 0.0)])
def test_a_plain_number_is_read(text: str, value: float) -> None:
    assert number(text) == value


STRANGE = (
    "",
    " ",
    "1_0",
    "\u0661",
    "\uff11",
    "nan",
    "inf",
    "-Infinity",
    "1e999",
    "0x10",
    "1,5",
    "1 0",
    "1\n",
    "--1",
    "e5",
)


@pytest.mark.parametrize("text", STRANGE)
def test_what_only_python_takes_for_a_number_is_refused_in_words(text: str) -> None:
    with pytest.raises(ValueError, match=r"^expected a number, such as -1\.5, got '"):
        number(text)
    with pytest.raises(ValueError, match=r"^expected a whole number from 0 to 9, got '"):
        whole(text, 0, 9)


@pytest.mark.parametrize("text", ["10", "-1", "1.0", "1e0", "9" * 5000])
def test_a_whole_number_is_one_in_range(text: str) -> None:
    with pytest.raises(ValueError, match=r"^expected a whole number from 0 to 9, got '"):
        whole(text, 0, 9)
    assert whole(" +7", 0, 9) == 7


def test_several_numbers_are_as_many_as_expected() -> None:
    assert numbers("0, -1.5,2", 3) == (0.0, -1.5, 2.0)
    for text, got in (("0,1", "2"), ("", "none"), ("1,2,3,4", "4")):
        with pytest.raises(ValueError, match=f"^expected 3 numbers with commas between, got {got}: "):
            numbers(text, 3)


def test_a_byte_order_mark_is_no_text() -> None:
    assert decode(b"\xef\xbb\xbfname") == decode(b"name") == "name"
    with pytest.raises(ValueError, match=r"^expected UTF-8 text: byte 1 is 0xff$"):
        decode(b"a\xff")
