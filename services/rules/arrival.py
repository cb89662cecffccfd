"""From when on F/T samples show a motion, in the sensor's own time. Pure.

Sensor and robot link are two processes, perhaps on two machines; their times of day need not agree, and a wrong answer
would have the task learn from a force felt before the motion. So the sensor's clock is watched: a packet says what time
it was there when its newest sample was taken, and it came here a little later, never earlier. The least delay of the
last second tells the sensor's time now to within that delay, from below; the settle time is there to cover it. Where
our own time of day agrees to within a quarter of a second it is taken to be the same clock, and the later of the two
counts. Too late an answer only makes the task wait a moment longer. A clock that goes back is another one: nothing of
what the one before it said is kept.
"""

from __future__ import annotations

from services.rules.senses import LeastDelay

_SAME_CLOCK_NS = 250_000_000


class SensorClock:
    """The sensor's time, as far as its packets tell."""

    def __init__(self) -> None:
        self._delay = LeastDelay()
        self._heard_ns = self._last_ns = -1

    def heard(self, t_ns: int, monotonic_ns: int) -> None:
        """Note a packet's time and when it came [ns]."""
        if t_ns < self._heard_ns:  # another sensor, or a clock that was set back
            self._delay.forget()
            self._last_ns = -1
        self._heard_ns = t_ns
        self._delay.heard(t_ns, monotonic_ns)

    def arrived(self, monotonic_ns: int, day_ns: int, settle_ns: int) -> int:
        """Return the sensor's time ``settle_ns`` after an arrival at these times of ours.

        It is later than any before, as long as the clock is the same.
        """
        there_ns = self._delay.there_ns(monotonic_ns)
        now_ns = day_ns if there_ns is None else there_ns
        if abs(day_ns - now_ns) <= _SAME_CLOCK_NS:
            now_ns = max(now_ns, day_ns)
        self._last_ns = max(self._last_ns + 1, now_ns + settle_ns)
        return self._last_ns
