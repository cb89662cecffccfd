"""The low-pass between the simulated sensor's samples and what is read of them: it remembers the motions so far.

While a motion lasts, the load goes evenly from the one before it to the one after it, and stays there. An episode
begins with a filter that has come to rest.
"""

from __future__ import annotations

from collections.abc import Sequence

from services.wire import low_pass
from services.wire.definition import Sensor

Six = Sequence[float]
"""Force [N] and torque [N m], six components."""


class LowPass:
    """The filter of one sensor."""

    def __init__(self, sensor: Sensor) -> None:
        """Take a sensor with a filter."""
        self._share = low_pass.share(sensor)
        self._at_rest = low_pass.quieter(sensor)
        """Error of what is shown of a load that has stood for long, as a part of a sample's."""
        self._moving = low_pass.motion_samples(sensor)
        self._load: Six | None = None
        """Where the load was after the last motion."""
        self._shown = [0.0] * 6

    def before(self, at_rest: bool) -> int:
        """Return how many errors are needed before those of the samples that are read."""
        return 1 if at_rest or self._load is None else self._moving

    def read(self, load: Six, errors: Sequence[Six], at_rest: bool) -> list[list[float]]:
        """Return the filtered samples of a load, one for each row of ``errors`` after the first ``before``.

        ``at_rest``: the load has stood for long, and the first error is that of all samples until now.
        """
        part, first = self._share, self.before(at_rest)
        if at_rest or self._load is None:
            shown = [a + self._at_rest * e for a, e in zip(load, errors[0], strict=True)]
        else:
            was, shown = self._load, self._shown
            for number, error in enumerate(errors[:first], start=1):
                way = number / first
                samples = [a + way * (b - a) + e for a, b, e in zip(was, load, error, strict=True)]
                shown = [y + part * (x - y) for x, y in zip(samples, shown, strict=True)]
        read = list[list[float]]()
        for error in errors[first:]:
            shown = [y + part * (x + e - y) for x, e, y in zip(load, error, shown, strict=True)]
            read.append(shown)
        self._load, self._shown = load, shown
        return read
