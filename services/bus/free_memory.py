"""Memory that is free goes back to the machine."""

from __future__ import annotations

import ctypes


def give_back() -> None:
    """Return what the C library keeps of freed memory, of all its arenas; nothing where it has no call for that.

    Payloads come in pieces that are too small to be mapped one by one, so that after one that was far too large, and
    refused, the process would stay as large as it once was.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
