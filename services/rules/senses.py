"""What is felt, as far as it can be believed: fresh by the sensor's own number and time, and alive. Pure.

A packet renews the age only when its number and its time are both later than those before: a gateway that hangs and
goes on sending its last packet has nothing new to say. Neither has one that is late: how late, the least delay of the
last second tells, without any two clocks that agree.

A sensor whose numbers or clock went back is another source. It is taken over as soon as a few of its packets follow
each other, so that an old packet never passes for one; at most every ``TURN_EVERY_S``, so that neither do old packets
that go round in circles.

A sensor that is alive shows noise, where the definition expects it: the same count again and again is a dead amplifier
or a cable on the wrong card. How many motions that takes follows from the noise and the size of a count.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Literal

from services.wire.definition import Definition
from services.wire.messages import FtPacket

NS = 1_000_000_000
TURN_EVERY_S = 10.0
RISING = 3
"""Packets of another source that must follow each other before it is believed."""
CHANCE = 1e-12
"""Of noise that shows the same count for so many motions: then it is no noise."""
LEAST_MOTIONS, LEAST_OF_ONE, MOST_MOTIONS = 5, 20, 1000
"""After how many motions without a change a sensor, and one of its components, are dead at the earliest.

Where it would take more than the most, nothing can be said.
"""
_AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
_WINDOW_NS = NS

Taken = Literal["new", "old", "other"]
"""What a packet is: newer than those before; old, or not yet believed; the first of another source."""


class LeastDelay:
    """How far a sensor's clock is ahead of ours, by the packet of the last second that was least delayed."""

    def __init__(self) -> None:
        self._ahead_ns: deque[tuple[int, int]] = deque()
        """When a packet came here, and its time less ours: falling, so that the first is the greatest."""

    def heard(self, t_ns: int, now_ns: int) -> None:
        """Note a packet's time and when it came [ns]."""
        kept, ahead_ns = self._ahead_ns, t_ns - now_ns
        while kept and kept[-1][1] <= ahead_ns:
            kept.pop()
        kept.append((now_ns, ahead_ns))
        while kept[0][0] < now_ns - _WINDOW_NS:
            kept.popleft()

    def there_ns(self, now_ns: int) -> int | None:
        """Return the sensor's time now, to within the least delay, from below; None before the first packet."""
        return now_ns + self._ahead_ns[0][1] if self._ahead_ns else None

    def forget(self) -> None:
        """Begin anew, with another clock."""
        self._ahead_ns.clear()


class Freshness:
    """The newest sample of a sensor, and how old it is."""

    def __init__(self) -> None:
        self.newest: FtPacket | None = None
        self._heard_ns = 0
        self._delay = LeastDelay()
        self._other: FtPacket | None = None
        self._rising = 0
        self._turned_ns: int | None = None

    def take(self, packet: FtPacket, now_ns: int) -> Taken:
        """Take a packet that came at ``now_ns`` of our clock, and return what it is."""
        if self.newest is None or _follows(packet, self.newest):
            self._accept(packet, now_ns)
            return "new"
        self._rising = self._rising + 1 if self._other is not None and _follows(packet, self._other) else 1
        self._other = packet
        early = self._turned_ns is not None and now_ns - self._turned_ns < TURN_EVERY_S * NS
        if self._rising < RISING or early:
            return "old"
        self._turned_ns = now_ns
        self._delay.forget()
        self._accept(packet, now_ns)
        return "other"

    def forget(self) -> None:
        """Take whatever comes next for new: the sensor begins anew, as the simulator's does with each ``home``."""
        self.newest = None
        self._delay.forget()

    def age_s(self, now_ns: int) -> float:
        """Return how old the newest sample is [s]: since it came here, or by the sensor's clock if that is more."""
        if self.newest is None:
            return math.inf
        there_ns = self._delay.there_ns(now_ns)
        late_ns = 0 if there_ns is None else there_ns - self.newest.t_ns
        return max(now_ns - self._heard_ns, late_ns) / NS

    def _accept(self, packet: FtPacket, now_ns: int) -> None:
        self.newest, self._heard_ns = packet, now_ns
        self._other, self._rising = None, 0
        self._delay.heard(packet.t_ns, now_ns)


class Senses(Freshness):
    """The same for a robot, and whether the sensor is alive."""

    def __init__(self, definition: Definition) -> None:
        super().__init__()
        self._load: tuple[float, ...] = ()
        self._still = [0] * len(_AXES)
        """Motions since a component changed."""
        self._most_still, self._most_dead = _patience(definition)
        self._least_still = min(*self._most_still, self._most_dead)

    def take(self, packet: FtPacket, now_ns: int) -> Taken:
        """See Freshness."""
        taken = super().take(packet, now_ns)
        if taken != "old":
            self._look(packet)
        return taken

    def homed(self) -> None:
        """Take note of a ``home``: what was repeated before it does not count."""
        self._still = [0] * len(_AXES)

    def moved(self) -> None:
        """Take note of a motion."""
        self._still = [count + 1 for count in self._still]

    def dead(self) -> str | None:
        """Return why the sensor is not alive, or None."""
        if max(self._still) < self._least_still:
            return None
        still = [name for name, count, most in zip(_AXES, self._still, self._most_still, strict=True) if count >= most]
        if min(self._still) >= self._most_dead:
            still = list(_AXES)
        if not still:
            return None
        motions = min(count for name, count in zip(_AXES, self._still, strict=True) if name in still)
        got = f"the very same {', '.join(still)} in {motions} motions"
        return f"guard: sensor: expected one that shows noise, got {got}; is it dead? only home is taken"

    def _look(self, packet: FtPacket) -> None:
        """Note which components change."""
        for force_n, torque_nm in zip(packet.force_n, packet.torque_nm, strict=False):
            load = (*force_n, *torque_nm)
            if load != self._load:
                before = self._load or (math.nan,) * len(load)
                self._still = [
                    count if old == new else 0 for count, old, new in zip(self._still, before, load, strict=True)
                ]
                self._load = load


def _follows(packet: FtPacket, other: FtPacket) -> bool:
    """Return whether a packet is newer than another, by number and by time."""
    return packet.sequence > other.sequence and packet.t_ns > other.t_ns


def _patience(definition: Definition) -> tuple[Sequence[float], float]:
    """Return after how many motions without a change each component is dead, and after how many all of them are."""
    noise, sensor = definition.noise, definition.sensor
    spreads = [noise.scale * noise.force_n] * 3 + [noise.scale * noise.torque_nm] * 3
    counts = [sensor.full_scale_n / 16384] * 3 + [sensor.full_scale_dnm / 163840] * 3
    # The likeliest count shows again with this chance, whatever the load is.
    same = [
        math.erf(count / spread / math.sqrt(8.0)) if spread else 1.0
        for count, spread in zip(counts, spreads, strict=True)
    ]
    return [_motions(chance, LEAST_OF_ONE) for chance in same], _motions(math.prod(same), LEAST_MOTIONS)


def _motions(chance: float, least: int) -> float:
    """Return how many motions without a change are less likely than CHANCE, each with this chance; or the least."""
    if chance >= 1.0:
        return math.inf
    motions = least if chance == 0.0 else max(least, math.ceil(math.log(CHANCE) / math.log(chance)))
    return motions if motions <= MOST_MOTIONS else math.inf
