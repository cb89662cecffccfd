"""What the commands print on: a terminal or a log, whose width and characters are what they are."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from typing import IO

from rich.console import Console
from rich.progress import TextColumn

from services.rules.command_line import give_up

LOG_WIDTH = 160
"""Characters of a line where there is no terminal: tables are not broken there."""


class PlainConsole(Console):
    """A console on which text is text: square brackets in names, paths and addresses mean nothing."""

    def on_broken_pipe(self) -> None:
        """Leave it to the command what it means that whoever reads has gone."""
        raise  # it is called while the error is handled


def console(*, stderr: bool = False, least_width: int = 0, file: IO[str] | None = None) -> Console:
    """Return a console that does not break tables when it is not a terminal, and takes no text for markup.

    ``least_width`` is for a table that is better broken by the terminal than by us.
    """
    plain = PlainConsole(stderr=stderr, file=file, markup=False, highlight=False, emoji=False)
    with suppress(AttributeError, ValueError):  # what stands in for a terminal need not have it
        plain.file.reconfigure(errors="replace")  # type: ignore[attr-defined]  # a locale may lack a character
    width = plain.width if plain.is_terminal else LOG_WIDTH
    if width != plain.width or width < least_width:
        plain.width = max(width, least_width)
    return plain


def description() -> TextColumn:
    """Return the column with what a bar is about: text too, which rich's own takes for markup."""
    return TextColumn("{task.description}", markup=False)


class Unread:
    """Lets a command that has more to do than to print go on when its output cannot be written."""

    def __init__(self, program: str) -> None:
        """``program`` stands before the one line about it on stderr."""
        self._program = program

    def attempt(self, write: Callable[[], None]) -> None:
        """Write; the first time that it cannot be, say so on stderr, and let stdout lead nowhere from then on."""
        try:
            write()
            sys.stdout.flush()
        except OSError as error:
            give_up(sys.stdout)
            with suppress(OSError, ValueError):
                why = error.strerror or type(error).__name__
                print(f"{self._program}: standard output: {why}; the run goes on unread", file=sys.stderr, flush=True)
