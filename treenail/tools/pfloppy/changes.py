"""What the difference between two directories asks of the folder. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from treenail.tools.pfloppy.layout import Entry


@dataclass(frozen=True)
class Changes:
    """To be made in this order: a failure on the way then loses nothing."""

    saved: tuple[Entry, ...]
    """Files to write: new ones, and those whose blocks or length are others now."""
    renamed: dict[str, Entry]
    """New entries by old name: the same blocks under another name."""
    deleted: tuple[str, ...]


def changes(old: Mapping[str, Entry], new: Mapping[str, Entry]) -> Changes:
    """Return what leads from one directory to another, both by name."""
    gone = {name: entry for name, entry in old.items() if name not in new}
    by_place = {(entry.start, entry.length): name for name, entry in gone.items() if entry.length}
    saved, renamed = [], {}
    for name, entry in new.items():
        before = by_place.pop((entry.start, entry.length), None) if name not in old else None
        if before is not None:
            renamed[before] = entry
        elif old.get(name) != entry:
            saved.append(entry)
    return Changes(tuple(saved), renamed, tuple(name for name in gone if name not in renamed))
