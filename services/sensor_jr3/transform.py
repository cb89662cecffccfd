"""Coordinate transforms of the receiver: lists of links, as words of a slot and as text. Pure.

``TZ 12.5, RX 180`` moves the sensor's axes by 12.5 mm along Z, then turns them by 180 deg about the new X. Amounts are
mm in the unit system's length, -32768 to 32767 of it, and degrees, -180 to 180; ``NEG`` (negate all axes) has none.
"""

from __future__ import annotations

from fractions import Fraction
from typing import NamedTuple

from services.rules.settings import SettingError
from services.sensor_jr3.memory_map import END, HALF_TURN, MOST_LINKS, NEGATE, RX, RZ, TX, TZ

_NAMES = {"TX": 1, "TY": 2, "TZ": 3, "RX": 4, "RY": 5, "RZ": 6, "NEG": NEGATE}


class Link(NamedTuple):
    """One step of a transform."""

    kind: int
    """1 to 7: TX TY TZ RX RY RZ NEG."""
    amount: float
    """mm or degrees."""


def parse(text: str) -> tuple[Link, ...]:
    """Return the links in a text; empty text is the identity. Raises SettingError."""
    links = []
    for part in (part.strip() for part in text.split(",") if part.strip()):
        name, _, amount = part.partition(" ")
        kind = _NAMES.get(name.upper())
        if kind is None or (kind == NEGATE) != (amount.strip() == ""):
            raise SettingError(f"transform: expected links such as TZ 12.5, RX 180 or NEG, got {part[:40]!r}")
        try:
            links.append(Link(kind, float(amount) if amount else 0.0))
        except ValueError:
            raise SettingError(f"transform: {name}: expected a number, got {amount[:20]!r}") from None
    return tuple(links)


def words(links: tuple[Link, ...], length_mm: Fraction) -> list[int]:
    """Return the words of a slot, as unsigned 16-bit numbers; ``length_mm`` is the unit of a translation.

    Raises SettingError for too many links and for amounts that a word cannot hold.
    """
    if len(links) > MOST_LINKS:
        raise SettingError(f"transform: expected at most {MOST_LINKS} links, got {len(links)}")
    link_words: list[int] = []
    for kind, amount in links:
        link_words += [kind, _amount(kind, amount, length_mm)]
    return [*link_words, END]


def _amount(kind: int, amount: float, length_mm: Fraction) -> int:
    if TX <= kind <= TZ:
        most = float(32767 * length_mm)
        if not abs(amount) <= most:
            raise SettingError(f"transform: expected a translation of at most {most:g} mm, got {amount}")
        return round(Fraction(amount) / length_mm) & 0xFFFF
    if RX <= kind <= RZ:
        if not abs(amount) <= 180.0:
            raise SettingError(f"transform: expected a rotation of -180 to 180 deg, got {amount}")
        # Rounded, not truncated: an integer division makes 45 deg come out as 44.99. 180 and -180 are the same word.
        return round(Fraction(amount) * HALF_TURN / 180) & 0xFFFF
    return 0
