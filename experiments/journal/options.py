"""What commands that read journals share: options, where to look, errors in one line, progress."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

from experiments.journal.store_file import InFile, opened
from services.bus import command
from services.cell import client
from services.cell.stored import InCell, Stored
from services.cell.terminal import console, description
from services.rules import command_line
from services.rules.command_line import EXIT_DIFFERS
from services.wire.errors import CellError

T = TypeVar("T")

STORE_HELP = "a store's SQLite file, or the folder of a run with one, instead of a living cell; it is only read"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that say where journals come from."""
    parser.add_argument("--store", type=Path, metavar="FILE", help=STORE_HELP)
    parser.add_argument("--json", action="store_true", help="as JSON")
    client.add_arguments(parser)
    parser.set_defaults(cell=None)  # a file may be of any cells


@contextmanager
def places(arguments: argparse.Namespace, store: Path | None) -> Iterator[list[Stored]]:
    """Give what the stores of the cells in question have, in a file or, without one, in the living cell.

    Raises CellError when a file cannot be read or has no run, or when there is no router.
    """
    if store is None:
        arguments.cell = arguments.cell or os.environ.get(command.CELL, "a")
        with client.client_of(arguments) as cell:
            yield [InCell(cell)]
        return
    with opened(store) as file:
        cells = [arguments.cell] if arguments.cell else file.cells()
        if not cells:
            raise CellError(f"{file.path}: expected a run, got none")
        yield [InFile(file, cell) for cell in cells]


def status(program: str, act: Callable[[], bool]) -> int:
    """Do what ``act`` does and return the exit status: 0 when it says that all is equal, else 1, and 2 for an error."""
    return command_line.run(program, lambda: 0 if act() else EXIT_DIFFERS, unread=EXIT_DIFFERS)


def shown(items: Iterable[T], what: str, total: int | None) -> Iterator[T]:
    """Give the items, with a bar on stderr if that is a terminal."""
    screen = console(stderr=True)
    columns = (description(), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as progress:
        yield from progress.track(items, total=total, description=what)
