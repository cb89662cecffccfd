"""The emulated card in time: the DSP is brought up to now whenever somebody looks at it."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

from services.sensor_jr3 import memory_map as jr3
from services.sensor_jr3.card import Collected, Sample
from services.sensor_jr3.emulator.dsp import Dsp
from services.sensor_jr3.emulator.loads import Load

ROOM = 8192
"""Samples that are kept for who collects them: about a second at 8 kHz, as in the helper of a real card."""
MOST_COLLECTED = 1024
_LOOK_S = 0.0005
_MOST_BEHIND = 8000
"""Steps that are made up for one by one; of a longer time without anybody watching only counters are."""


class EmulatedCard:
    """A ``Card``; safe from any thread."""

    def __init__(
        self,
        dsp: Dsp,
        load_at: Callable[[float], Load] | None = None,
        clock: Callable[[], float] = time.monotonic,
        pause: Callable[[float], None] = time.sleep,
    ) -> None:
        """``load_at`` gives the load at a time since the start [s]; without it ``set_load`` does."""
        self._dsp = dsp
        self._load_at = load_at
        self._loads: tuple[Load, ...] = ()
        self._hold_steps = 1
        self._clock, self._pause = clock, pause
        self._lock = threading.RLock()
        self._began_s = clock()
        self._steps = 0
        self._watched: tuple[int, int] | None = None
        self._samples: deque[tuple[Sample, int]] = deque(maxlen=ROOM)
        self._last_counter: int | None = None

    def set_load(self, load: Load) -> None:
        """Have the sensor feel a load from now on; once this returns, filter 0 shows it."""
        self.play((load,), jr3.SAMPLE_RATE_HZ)

    def play(self, loads: Sequence[Load], rate_hz: int) -> None:
        """Have the sensor feel loads, so many a second, over and over; once this returns, filter 0 shows one of them.

        Who collects at this rate, a divisor of 8000, gets each of them once in a round.
        """
        with self._lock:
            self._catch_up()
            self._loads, self._hold_steps = tuple(loads), jr3.SAMPLE_RATE_HZ // rate_hz
            self._dsp.set_load(self._played())

    def read(self, address: int, count: int) -> list[int]:
        """Return words as they are now."""
        with self._lock:
            self._catch_up()
            return self._dsp.read(address, count)

    def write(self, address: int, value: int) -> None:
        """Write one word."""
        with self._lock:
            self._catch_up()
            self._dsp.write(address, value)

    def collect(self, counter: int, data: int, wait_s: float) -> Collected:
        """Return the samples since the last call."""
        began_s = self._clock()
        while True:
            with self._lock:
                self._watch(counter, data)
                self._catch_up()
                count = min(MOST_COLLECTED, len(self._samples))
                samples = [self._samples.popleft() for _ in range(count)]
            if samples:
                newest_s = self._began_s + samples[-1][1] / jr3.SAMPLE_RATE_HZ
                return Collected([sample for sample, _ in samples], newest_s - began_s)
            left_s = began_s + wait_s - self._clock()
            if left_s <= 0.0:
                return Collected([], 0.0)
            self._pause(min(left_s, _LOOK_S))

    def close(self) -> None:
        """Nothing is held."""

    def _watch(self, counter: int, data: int) -> None:
        if self._watched != (counter, data):
            self._catch_up()
            self._samples.clear()
            self._watched = (counter, data)
            self._last_counter = self._dsp.read(counter, 1)[0]

    def _catch_up(self) -> None:
        due = int((self._clock() - self._began_s) * jr3.SAMPLE_RATE_HZ)
        if due - self._steps > _MOST_BEHIND:
            self._dsp.skip(due - _MOST_BEHIND - self._steps)
            self._steps = due - _MOST_BEHIND
        while self._steps < due:
            self._steps += 1
            if self._load_at is not None:
                self._dsp.set_load(self._load_at(self._steps / jr3.SAMPLE_RATE_HZ))
            elif len(self._loads) > 1:
                self._dsp.set_load(self._played())
            if self._dsp.step() and self._watched is not None:
                self._sample(*self._watched)

    def _played(self) -> Load:
        """Return the load of this step."""
        return self._loads[self._steps // self._hold_steps % len(self._loads)]

    def _sample(self, counter: int, data: int) -> None:
        (now,) = self._dsp.read(counter, 1)
        if now == self._last_counter:
            return
        self._last_counter = now
        if self._dsp.faults["drop"]:
            self._dsp.faults["drop"] -= 1
            return
        counts = tuple(word - 65536 if word >= 32768 else word for word in self._dsp.read(data, 6))
        warnings, errors = self._dsp.read(jr3.address_of("warnings"), 2)
        self._samples.append((Sample(now, counts, warnings, errors), self._steps))
