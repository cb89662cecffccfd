"""What is felt after a motion, out of the sensor's single samples: their mean over a window of so many. Pure.

The window is the first ``sensor.window`` samples after the motion has ended that follow each other without a gap and
with a status that lets them be used. A sample that was lost, or that says of itself that it is none, begins it anew:
the mean is always that of so many samples, never of fewer.

The simulator's time stands still between two motions. It gives the samples of a motion in one packet, all of one time.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence

from msgspec.structs import replace

from services.wire.definition import Sensor
from services.wire.messages import Force, FtPacket, Torque

OTHER_RATE = 0.05
"""How far a sensor's rate may be from the one that is stated, as a part of it."""
KEPT = 64
"""Packets that are kept at least, to find the ones of a motion among."""
_UNUSABLE = ((0, "saturated"), (2, "lost"), (3, "changed"), (4, "not yet zeroed"))
"""Bits of ``FtPacket.status`` with which the force is not known."""

ANEW = 0b11100
"""The bits lost, changed and not yet zeroed: what is shown afterwards may have another zero."""

Load = tuple[Force, Torque]
"""Force [N] and torque [N m]."""


def unusable(status: int) -> str | None:
    """Return why samples with a status say nothing about the force, or None."""
    return next((name for bit, name in _UNUSABLE if status >> bit & 1), None)


def mean_load(packet: FtPacket) -> Load:
    """Return the mean force [N] and torque [N m] of a packet's samples."""
    return mean(packet.force_n), mean(packet.torque_nm)


def mean(samples: Sequence[Force]) -> Force:
    """Return the mean of one or more samples, component by component, shape (3,).

    That of equal samples is the sample itself, and the order does not matter, to the last bit: so an emulated sensor
    may play a simulator's samples over and over, and whichever so many of them follow each other have the same mean.
    """
    if len(samples) == 1:
        return samples[0]
    x, y, z = (_mean(column) for column in zip(*samples, strict=True))
    return x, y, z


def _mean(values: tuple[float, ...]) -> float:
    least, count = min(values), len(values)
    return least + math.fsum(value - least for value in values) / count


class Windows:
    """Finds the window of a motion among a sensor's packets."""

    def __init__(self, sensor: Sensor) -> None:
        self._window, self._at_home = sensor.window, max(sensor.window, sensor.tare_samples)
        self._samples = self._window
        self._rate_hz = sensor.rate_hz
        self._packets: deque[FtPacket] = deque(maxlen=max(KEPT, 2 * self._at_home))
        """The newest since a motion was asked for, but for those that were looked at."""
        self._chosen: list[Load] = []
        self._number = 0
        """Of the last one chosen."""
        self.why = ""
        """Why there is no window so far, where that is not only a matter of time."""

    def begin(self, *, at_home: bool = False) -> None:
        """Forget what was felt before a motion; ``at_home``: before one home, where a tare may take more samples."""
        self._samples = self._at_home if at_home else self._window
        self._packets.clear()
        self._chosen.clear()
        self.why = ""

    def take(self, packet: FtPacket) -> None:
        """Take a packet that is newer than those before."""
        self._packets.append(packet)

    def after(self, arrived_t_ns: int) -> FtPacket | None:
        """Return the samples in which a motion shows that ended at this time of the sensor [ns], or None so far.

        A packet of one time, the simulator's, has to be of the very time: one of a later time is not news but late, of
        an episode that has begun anew since.
        """
        if self._samples == 1:
            return self._newest(arrived_t_ns)
        while self._packets:
            packet = self._packets.popleft()
            window = self._at_once(packet, arrived_t_ns) if packet.period_ns == 0 else self._more(packet, arrived_t_ns)
            if window is not None:
                return window
        return None

    def _at_once(self, packet: FtPacket, arrived_t_ns: int) -> FtPacket | None:
        """Return a packet of one time if it is the window."""
        if packet.t_ns != arrived_t_ns or not self._usable(packet):
            return None
        if len(packet.force_n) != self._samples:
            self.why = f"expected {self._samples} samples, as the definition says, got {len(packet.force_n)}"
            return None
        return packet

    def _more(self, packet: FtPacket, arrived_t_ns: int) -> FtPacket | None:
        """Go on with a stream's packet; return the window once it is full."""
        if packet.t_ns < arrived_t_ns:
            return None
        if not self._usable(packet):
            self._chosen.clear()
            return None
        for sample, t_ns, load in _samples(packet):
            if t_ns < arrived_t_ns:
                continue
            if self._chosen and sample != self._number + 1:
                self._chosen.clear()
                self.why = "samples were lost"
            self._number = sample
            self._chosen.append(load)
            if len(self._chosen) == self._samples:
                return _of(self._chosen, sample, t_ns, packet.period_ns)
        return None

    def _newest(self, arrived_t_ns: int) -> FtPacket | None:
        """Return the newest packet that a motion shows in."""
        for packet in reversed(self._packets):
            late = packet.period_ns and packet.t_ns > arrived_t_ns
            if (packet.t_ns == arrived_t_ns or late) and self._usable(packet):
                return packet
        return None

    def _usable(self, packet: FtPacket) -> bool:
        """Return whether a packet's samples may count, and note why not."""
        why = unusable(packet.status)
        if why is not None:
            self.why = f"its status is {packet.status} ({why})"
            return False
        if len(packet.force_n) != len(packet.torque_nm):
            self.why = f"expected as many torques as forces, got {len(packet.torque_nm)} and {len(packet.force_n)}"
            return False
        if packet.period_ns and self._rate_hz:
            rate_hz = 1e9 / packet.period_ns
            if abs(rate_hz - self._rate_hz) > OTHER_RATE * self._rate_hz:
                expected = f"expected {self._rate_hz} samples a second, as sensor.rate_hz says"
                self.why = f"{expected}, got {rate_hz:.6g}"
                return False
        return True


def _samples(packet: FtPacket) -> Iterator[tuple[int, int, Load]]:
    """Give number, time [ns] and load of each sample of a stream's packet."""
    behind = len(packet.force_n)
    for load in zip(packet.force_n, packet.torque_nm, strict=True):
        behind -= 1
        yield packet.sequence - behind, packet.t_ns - behind * packet.period_ns, load


def _of(loads: Sequence[Load], sequence: int, t_ns: int, period_ns: int) -> FtPacket:
    """Return a packet of these loads, the last of which has this number and time [ns]."""
    forces, torques = zip(*loads, strict=True)
    return FtPacket(sequence=sequence, t_ns=t_ns, period_ns=period_ns, force_n=forces, torque_nm=torques)


def one_sample(sequence: int, t_ns: int, period_ns: int, status: int, load: Load) -> FtPacket:
    """Return a packet of a stream that tells each sample by itself."""
    force_n, torque_nm = load
    return FtPacket(
        sequence=sequence, t_ns=t_ns, period_ns=period_ns, status=status, force_n=(force_n,), torque_nm=(torque_nm,)
    )


class Rolling:
    """The mean over the newest window of a stream, for a guard that looks at what is felt at any time."""

    def __init__(self, samples: int) -> None:
        self._loads: deque[Load] = deque(maxlen=samples)
        self._samples = samples

    def take(self, packet: FtPacket) -> FtPacket:
        """Return a packet with the mean in the place of its samples; one that cannot be used is as it is.

        While there are not as many samples as a window has, it is the mean of fewer.
        """
        if self._samples == 1:
            return packet
        if unusable(packet.status) is not None or len(packet.force_n) != len(packet.torque_nm):
            self._loads.clear()
            return packet
        self._loads.extend(zip(packet.force_n, packet.torque_nm, strict=True))
        forces, torques = zip(*self._loads, strict=True)
        return replace(packet, force_n=(mean(forces),), torque_nm=(mean(torques),))

    def forget(self) -> None:
        """Begin anew: another sensor, or another motion's samples."""
        self._loads.clear()
