"""The disk's layout and the difference between two directories, as pure functions."""

from __future__ import annotations

import pytest

from treenail.tools.pfloppy.changes import changes
from treenail.tools.pfloppy.layout import Entry, LayoutError, PlainLayout


def test_a_directory_that_makes_no_sense_is_refused() -> None:
    layout = PlainLayout()
    entries = {0: Entry("A", 4, 600), 63: Entry("B.X", 6, 1)}
    assert layout.decode(layout.encode(entries)) == entries
    for wrong, entries in {
        "name of its own": {0: Entry("A", 4, 1), 1: Entry("A", 5, 1)},
        "blocks of its own": {0: Entry("A", 4, 600), 1: Entry("B", 5, 1)},
        "expected blocks 4 to 511": {0: Entry("A", 3, 1)},
        "to 511": {0: Entry("A", 511, 513)},
    }.items():
        with pytest.raises(LayoutError, match=wrong):
            layout.decode(layout.encode(entries))


def test_changes_are_told_apart() -> None:
    a, b, empty = Entry("A", 4, 10), Entry("B", 5, 10), Entry("E", 0, 0)
    moved = a._replace(name="C")
    assert changes({"A": a}, {"A": a}) == changes({}, {})
    assert changes({"A": a, "B": b}, {"C": moved, "E": empty}).__dict__ == {
        "saved": (empty,),
        "renamed": {"A": moved},
        "deleted": ("B",),
    }
