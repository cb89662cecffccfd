"""From records to packets: what was lost, came twice or late is counted, and never passes for new. Pure.

A sample's time is that of its number, at the stream's rate, put where the least delayed record of the last second says:
one that waited on its way is not taken for a later one.
"""

from __future__ import annotations

from collections.abc import Iterator

from services.rules.mount import Mount
from services.rules.senses import LeastDelay
from services.sensor_rdt.calibration import Calibration
from services.sensor_rdt.errors import RebootedError
from services.sensor_rdt.records import WRAP, Record, status_of, troubles
from services.wire.messages import Force, FtPacket, Torque

NS = 1_000_000_000
LATE = 1000
"""How many records one may come too late; a number further back is another stream's."""
_MOST_LOST = 1 << 24
Load = tuple[Force, Torque]


class Stream:
    """The records of one stream."""

    def __init__(self, calibration: Calibration, mount: Mount, rate_hz: float, batch: int) -> None:
        """``batch``: samples a packet, 1 to 64."""
        self.lost = self.repeated = self.late = self.taken = 0
        self.trouble = ""
        """What the newest record's status tells."""
        self.sequence = 0
        """Of the newest sample."""
        self.t_ns = 0
        self.load: Load = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        self._calibration, self._mount = calibration, mount
        self._period_ns, self._batch = round(NS / rate_hz), batch
        self._delay = LeastDelay()
        self._last: int | None = None
        self._steps = 0
        self._began_ns = 0
        self._pending: list[Load] = []
        self._status = 0

    def begin(self) -> None:
        """Begin with another stream of the same sensor."""
        self._last, self._pending = None, []
        self._delay.forget()

    def take(self, record: Record, came_ns: int) -> Iterator[FtPacket]:
        """Take a record that came at a time of day; give the packets that are full. Raises RebootedError."""
        step = self._step(record.rdt_sequence, came_ns)
        if step == 0:
            return
        status = status_of(record.status)
        self.trouble = troubles(record.status)
        other = status != self._status
        if self._pending and (other or step > 1):
            yield self._packet()
        self._steps += step
        self.sequence += step
        self.lost += step - 1
        self.taken += 1
        self._status = status
        self.load = self._mount.to_tool(*self._calibration.read(record.counts))
        self._pending.append(self.load)
        there_ns = self._began_ns + self._steps * self._period_ns
        self._delay.heard(there_ns, came_ns)
        ahead_ns = self._delay.there_ns(0) or 0
        self.t_ns = max(self.t_ns + 1, min(came_ns, there_ns - ahead_ns))
        if len(self._pending) >= self._batch or other:
            yield self._packet()

    def flush(self) -> Iterator[FtPacket]:
        """Give what is left."""
        if self._pending:
            yield self._packet()

    def say(self, status: int, now_ns: int) -> FtPacket:
        """Return a status without a sample: the load is the one felt last."""
        self.sequence += 1
        self.t_ns = max(self.t_ns + 1, now_ns)
        self._status, self._pending = status, [self.load]
        return self._packet()

    def _step(self, number: int, came_ns: int) -> int:
        """Return how far a record is ahead of the one before: 0 for one that is none. Raises RebootedError."""
        last = self._last
        if last is None:
            self._began_ns, self._steps = came_ns, 0
            self.sequence = max(self.sequence, came_ns // self._period_ns)
            self._last = number
            return 1
        step = (number - last) % WRAP
        if step == 0:
            self.repeated += 1
            return 0
        if step > WRAP - LATE:
            self.late += 1
            return 0
        if step > _MOST_LOST:
            raise RebootedError(f"sensor: expected record {last + 1}, got {number}: the box began anew")
        self._last = number
        return step

    def _packet(self) -> FtPacket:
        loads, self._pending = self._pending, []
        return FtPacket(
            sequence=self.sequence,
            t_ns=self.t_ns,
            period_ns=self._period_ns,
            status=self._status,
            force_n=tuple(force_n for force_n, _ in loads),
            torque_nm=tuple(torque_nm for _, torque_nm in loads),
        )
