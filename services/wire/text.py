"""Text that came from elsewhere: read as what it says, or made fit for a log, a terminal or an error of one line."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_NAME_RULE = re.compile(r"`str` matching regex '\^(?:\[([^\]]+)\])?\[([^\]]+)\]\{(\d+)(?:,(\d+))?\}\\+Z'")
_WHOLE = re.compile(r"[+-]?[0-9]{1,20}")


def number(text: str) -> float:
    """Return the number that a text is, such as ``-1.5`` or ``2e3``, blanks around it aside. Raises ValueError.

    Python would read more: ``1_0``, digits of other scripts, ``nan`` and ``inf`` are most often something gone wrong.
    """
    plain = text.strip(" \t")
    value = float(plain) if _NUMBER.fullmatch(plain) else math.nan
    if not math.isfinite(value):
        raise ValueError(f"expected a number, such as -1.5, got {one_line(text, 40)!r}")
    return value


def numbers(text: str, count: int) -> tuple[float, ...]:
    """Return so many numbers with commas between. Raises ValueError."""
    words = text.split(",")
    if len(words) != count:
        got = len(words) if text.strip() else "none"
        raise ValueError(f"expected {count} numbers with commas between, got {got}: {one_line(text, 80)!r}")
    return tuple(map(number, words))


def whole(text: str, least: int, most: int) -> int:
    """Return the whole number from ``least`` to ``most`` that a text is, blanks around it aside. Raises ValueError."""
    plain = text.strip(" \t")
    if not (_WHOLE.fullmatch(plain) and least <= int(plain) <= most):
        raise ValueError(f"expected a whole number from {least} to {most}, got {one_line(text, 40)!r}")
    return int(plain)


def decode(raw: bytes) -> str:
    """Return the text in a file, without the byte order mark that some editors begin it with.

    Raises ValueError when it is not UTF-8.
    """
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"expected UTF-8 text: byte {error.start} is {raw[error.start]:#04x}") from None


def in_words(complaint: str) -> str:
    """Return a complaint of msgspec's with the rule for a name in words instead of as a regular expression."""
    return _NAME_RULE.sub(_rule_in_words, complaint)


def _rule_in_words(rule: re.Match[str]) -> str:
    first, rest, least, most = rule.groups()
    others = " ".join(re.findall(".-.|.", rest))
    if first is None:
        return f"{least} of {others}"
    counts = f"{int(least) + 1} to {int(most) + 1}"
    return f"{counts} of {others}, the first of {' '.join(re.findall('.-.|.', first))}"


def one_line(text: str, most: int = 300) -> str:
    """Return a text as one printable line of at most ``most`` characters (4 or more).

    What is not printable, such as a line break or a terminal's escape code, becomes ``?``; a longer text ends in
    ``...``.
    """
    if len(text) > most:
        text = f"{text[: most - 3]}..."
    return text if text.isprintable() else "".join(character if character.isprintable() else "?" for character in text)


def spans(numbers: Iterable[int]) -> str:
    """Return whole numbers in words, as in ``0 to 22, 24, 26 to 40``."""
    ranges: list[list[int]] = []
    for number in sorted(numbers):
        if ranges and number == ranges[-1][1] + 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    return ", ".join(str(first) if first == last else f"{first} to {last}" for first, last in ranges)
