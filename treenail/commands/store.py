"""``treenail store check FILE`` and ``treenail store salvage FILE OUT``: a store's file that is damaged.

No store may have it open, and it is not written to.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

from services.rules.command_line import Parser
from services.store import salvage
from services.store.sqlite_file import StoreError, what_to_do
from services.wire.errors import CellError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    how = parser.add_subparsers(dest="how", metavar="check|salvage", required=True)
    check = how.add_parser(
        "check", help="say what of a store's file is damaged, and how far its runs can be gone on with"
    )
    check.add_argument("file", type=Path, metavar="FILE", help="the store's SQLite file")
    save = how.add_parser("salvage", help="write what can be gone on with into a new file")
    save.add_argument("file", type=Path, metavar="FILE", help="the store's SQLite file; it is left as it is")
    save.add_argument("out", type=Path, metavar="OUT", help="the new file")


def act(arguments: argparse.Namespace) -> int:
    """Do it; return 0 when nothing is damaged, or what was not has been saved, else 1."""
    file: Path = arguments.file
    with tempfile.TemporaryDirectory(prefix="treenail-") as folder:
        salvaged = salvage.look(file, Path(folder))
    if arguments.how == "check":
        print("\n".join(salvage.report(salvaged, file)))
        whole = salvaged.complaint is None and not salvaged.damaged
        if not whole:
            print(what_to_do(file))
        return 0 if whole else 1
    try:
        left = salvage.write(salvaged, arguments.out)
    except (StoreError, OSError) as error:
        raise CellError(f"{arguments.out}: cannot be written: {error}") from error
    print("\n".join([*(run.said for run in left), f"written: {arguments.out}; {file} is as it was"]))
    return 0


def main(words: Sequence[str]) -> int:
    """Do what the command line says and return the exit status. Raises CellError."""
    parser = Parser(prog="treenail store", description=__doc__)
    add_arguments(parser)
    return act(parser.parse_args(words))
