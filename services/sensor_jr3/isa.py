"""``isa:0x260``: a receiver card in this machine, by 16-bit port cycles of a compiled helper.

/dev/port is no way: it makes one byte-wide cycle a byte, and the card needs 16 bits at once.
"""

from __future__ import annotations

import ctypes
import os
from pathlib import Path

from services.rules.settings import SettingError
from services.sensor_jr3 import memory_map as jr3
from services.sensor_jr3 import words
from services.sensor_jr3.build_port import COMMAND, LIBRARY, check_machine
from services.sensor_jr3.card import Collected, LinkError
from services.sensor_jr3.words import SAMPLE_WORDS

MOST_BASE = 0x3FC
"""Last base address for which Linux grants single ports."""


class IsaCard:
    """A ``Card`` at an I/O port; only one process may use it."""

    def __init__(self, base: int, library: Path = LIBRARY) -> None:
        """Raise SettingError without helper or privilege, and on machines without ports."""
        check_machine()
        if not library.exists():
            raise SettingError(f"isa: expected the compiled helper {library.name}, got none; build it: {COMMAND}")
        self._base = base
        self._watched: tuple[int, int] | None = None
        self._lib = ctypes.CDLL(str(library), use_errno=True)
        self._lib.jr3_now_ns.restype = ctypes.c_int64
        self._lib.jr3_watch.argtypes = (ctypes.c_uint16, ctypes.c_uint16, ctypes.c_uint16, ctypes.c_long)
        self._lib.jr3_collect.argtypes = (ctypes.c_int, ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p)
        if self._lib.jr3_open(ctypes.c_uint16(base)):
            reason = os.strerror(ctypes.get_errno())
            expected = "expected root or CAP_SYS_RAWIO, and a kernel with ioperm that is not locked down"
            raise SettingError(f"isa:{base:#x}: {expected}, got {reason}")

    def read(self, address: int, count: int) -> list[int]:
        """Return words."""
        buffer = (ctypes.c_uint16 * count)()
        self._lib.jr3_read(ctypes.c_uint16(self._base), ctypes.c_uint16(address), ctypes.c_uint16(count), buffer)
        return list(buffer)

    def write(self, address: int, value: int) -> None:
        """Write one word."""
        self._lib.jr3_write(ctypes.c_uint16(self._base), ctypes.c_uint16(address), ctypes.c_uint16(value))

    def collect(self, counter: int, data: int, wait_s: float) -> Collected:
        """Return what the helper's thread has seen since the last call."""
        if self._watched != (counter, data):
            if self._lib.jr3_watch(self._base, counter, data, _rest_ns(counter)):
                raise LinkError("isa: expected to be able to start a thread for the samples")
            self._watched = (counter, data)
        buffer = (ctypes.c_uint16 * (SAMPLE_WORDS * words.MOST_SAMPLES))()
        newest_ns = ctypes.c_int64()
        began_ns = self._lib.jr3_now_ns()
        count = self._lib.jr3_collect(words.MOST_SAMPLES, round(wait_s * 1e9), buffer, ctypes.byref(newest_ns))
        samples = words.samples_in(buffer[: count * SAMPLE_WORDS])
        return Collected(samples, (newest_ns.value - began_ns) * 1e-9 if count else 0.0)

    def close(self) -> None:
        """Stop the helper's thread."""
        self._lib.jr3_stop()


def _rest_ns(counter: int) -> int:
    """Return how long the thread may rest between looks: an eighth of a period, never at rates where that is short."""
    number = counter - jr3.counter_address(1)
    period_ns = 1_000_000_000 // jr3.SAMPLE_RATE_HZ * 4 ** max(0, number)
    return period_ns // 8 if period_ns >= 2_000_000 else 0
