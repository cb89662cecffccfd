"""The files that are recorded to: each start takes a new one, so that nothing recorded is ever lost."""

from __future__ import annotations

from itertools import count
from pathlib import Path

from services.wire.errors import CellError


def new_piece(path: Path) -> Path:
    """Make the first of ``run.rrd``, ``run.1.rrd``, ``run.2.rrd`` and so on that is not there yet, and return it.

    Rerun can only begin a file anew, so that a viewer which is started again must not be given the one from before.
    Raises CellError when there is no folder to write to, or none to be written to.
    """
    for number in count():
        piece = path if number == 0 else path.with_name(f"{path.stem}.{number}{path.suffix}")
        try:
            with piece.open("xb"):
                return piece
        except FileExistsError:
            continue
        except (OSError, ValueError) as error:
            raise CellError(f"viewer: --save {piece}: cannot be written: {error}") from error
    raise AssertionError("numbers do not end")
