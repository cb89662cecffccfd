"""Text from elsewhere becomes one printable line."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.wire.text import one_line


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
