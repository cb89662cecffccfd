"""The low-pass between the simulated sensor's samples and what is read of them: it remembers the motions so far.

While a motion lasts, the load goes evenly from the one before it to the one after it, and stays there. An episode
begins with a filter that has come to rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from services.wire import low_pass
from services.wire.definition import Sensor

Six = Sequence[float]
"""Force [N] and torque [N m], six components."""
RESTS = 10.0
"""Time constants that it is given to come to rest."""


class LowPass:
    """The filter of one sensor."""

    def __init__(self, sensor: Sensor) -> None:
        """Take a sensor with a filter."""
        self._share = low_pass.share(sensor)
        self._moving = low_pass.motion_samples(sensor)
        self._rest = math.ceil(RESTS / self._share)
        self._load: Six | None = None
        """Where the load was after the last motion."""
        self._shown = [0.0] * 6

    def before(self, at_start: bool) -> int:
        """Return how many samples come before those that are read after a motion, or at an episode's start."""
        return self._rest if at_start or self._load is None else self._moving

    def read(self, load: Six, errors: Sequence[Six], at_start: bool) -> list[list[float]]:
        """Return the filtered samples that are read of a load, one for each row of ``errors`` after ``before``."""
        first = self.before(at_start)
        if at_start or self._load is None:
            self._load, self._shown = load, list(load)
        part, shown, was = self._share, self._shown, self._load
        read = list[list[float]]()
        for number, error in enumerate(errors, start=1):
            way = min(1.0, number / first)
            samples = [a + way * (b - a) + e for a, b, e in zip(was, load, error, strict=True)]
            shown = [y + part * (x - y) for x, y in zip(samples, shown, strict=True)]
            if number > first:
                read.append(shown)
        self._load, self._shown = load, shown
        return read
