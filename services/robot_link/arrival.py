"""From when on F/T samples show a motion, in the sensor's own time. Pure.

Sensor and robot link are two processes, perhaps on two machines; their times of day need not agree, and a wrong answer
would have the task learn from a force felt before the motion. So the sensor's clock is watched: a packet says what time
it was there when its newest sample was taken, and it came here a little later, never earlier. The least delay among the
newest packets tells the sensor's time now to within that delay, from below; the settle time is there to cover it. Where
our own time of day agrees to within a quarter of a second it is taken to be the same clock, and the later of the two
counts. Too late an answer only makes the task wait a moment longer.
"""

from __future__ import annotations

from collections import deque

_KEPT = 512
_SAME_CLOCK_NS = 250_000_000


class SensorClock:
    """The sensor's time, as far as its packets tell."""

    def __init__(self) -> None:
        self._ahead_ns: deque[int] = deque(maxlen=_KEPT)
        self._last_ns = -1

    def heard(self, t_ns: int, monotonic_ns: int) -> None:
        """Note a packet's time and when it came [ns]."""
        ahead_ns = t_ns - monotonic_ns
        if self._ahead_ns and abs(ahead_ns - self._ahead_ns[-1]) > _SAME_CLOCK_NS:
            self._ahead_ns.clear()  # another sensor, or a clock that was set
        self._ahead_ns.append(ahead_ns)

    def arrived(self, monotonic_ns: int, day_ns: int, settle_ns: int) -> int:
        """Return the sensor's time ``settle_ns`` after an arrival at these times of ours; later than any before."""
        now_ns = monotonic_ns + max(self._ahead_ns) if self._ahead_ns else day_ns
        if abs(day_ns - now_ns) <= _SAME_CLOCK_NS:
            now_ns = max(now_ns, day_ns)
        self._last_ns = max(self._last_ns + 1, now_ns + settle_ns)
        return self._last_ns
