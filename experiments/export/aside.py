"""What is exported is written aside, and given its name when it is whole: there is never half of it under that name."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from services.wire.errors import TreenailError

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class ExportError(TreenailError):
    """Something cannot be exported; nothing of it is there."""


@contextmanager
def aside(path: Path, *, force: bool) -> Iterator[Path]:
    """Give a place to write ``path``, a file or a folder, to: of the same name in a folder beside it, on the same disk.

    When all went well it takes the place of ``path``, and of what was there with ``force``. Raises ExportError
    when something is there without it, when the disk is full, and for whatever else keeps it from being written.
    """
    path = path.absolute()
    if os.path.lexists(path) and not force:
        raise ExportError(f"{path}: expected nothing there yet, got {_kind(path)}; --force replaces it")
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        beside.mkdir()
        yield beside / path.name
        _take_place(beside, path)
    except OSError as error:
        if error.filename is not None and not str(error.filename).startswith(str(beside)) and not _full(error):
            raise
        raise ExportError(f"{path}: cannot be written, and nothing of it is there: {_reason(error)}") from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def _take_place(beside: Path, path: Path) -> None:
    if os.path.lexists(path):
        path.rename(beside / "before")  # goes with the folder aside
    (beside / path.name).replace(path)


def _full(error: OSError) -> bool:
    return error.errno in _FULL or os.strerror(errno.ENOSPC) in str(error)


def _reason(error: OSError) -> str:
    """Return why, in words; libraries wrap what the system says in their own."""
    if _full(error):
        return os.strerror(error.errno if error.errno in _FULL else errno.ENOSPC)
    return error.strerror or str(error)


def _kind(path: Path) -> str:
    return "a folder" if path.is_dir() else "a file"
