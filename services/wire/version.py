"""The version of the installed distribution."""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed_version


@cache
def version() -> str:
    """Return the version of the installed ``treenail``, or "0+unknown" when run from a bare folder."""
    try:
        return installed_version("treenail")
    except PackageNotFoundError:
        return "0+unknown"
