"""Text that came from elsewhere, made fit for a log, a terminal or an error of one line."""

from __future__ import annotations


def one_line(text: str, most: int = 300) -> str:
    """Return a text as one printable line of at most ``most`` characters (4 or more).

    What is not printable, such as a line break or a terminal's escape code, becomes ``?``; a longer text ends in
    ``...``.
    """
    if len(text) > most:
        text = f"{text[: most - 3]}..."
    return text if text.isprintable() else "".join(one if one.isprintable() else "?" for one in text)
