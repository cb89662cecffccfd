"""From collected samples to packets: counting what was lost, thinning out, batching. Pure; time is an argument."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from services.rules.ft_counts import FtCounts
from services.rules.mount import Mount
from services.rules.settings import SettingError
from services.sensor_jr3 import memory_map as jr3
from services.sensor_jr3.card import Collected, Sample
from services.sensor_jr3.status import status_of
from services.wire.messages import Force, FtPacket, Torque

NS = 1_000_000_000
_WRAP = 1 << 16


@dataclass(frozen=True)
class Pace:
    """Which counter is watched for a rate, and every how manieth of its steps is a sample."""

    counter: int
    """1 to 6."""
    every: int
    period_ns: int
    """Between two published samples."""

    @property
    def step_ns(self) -> int:
        """Time between two steps of the counter."""
        return self.period_ns // self.every


def pace_of(rate_hz: int) -> Pace:
    """Return how to take ``rate_hz`` samples a second: with the slowest counter that is fast enough.

    Raises SettingError for a rate that does not divide 8000, or is not 8 to 8000.
    """
    if not (8 <= rate_hz <= jr3.SAMPLE_RATE_HZ and jr3.SAMPLE_RATE_HZ % rate_hz == 0):
        raise SettingError(f"rate: expected a divisor of 8000 from 8 to 8000 Hz, got {rate_hz}")
    steps = jr3.SAMPLE_RATE_HZ // rate_hz
    counter, every = 1, steps
    while every % 4 == 0 and counter < 6:
        counter, every = counter + 1, every // 4
    return Pace(counter, every, NS // jr3.SAMPLE_RATE_HZ * steps)


def steps_between(before: int, after: int, expected: int) -> int:
    """Return how far a 16-bit counter went when about ``expected`` steps' time went by; 0 for not at all.

    The counter alone cannot tell whether it wrapped once more; the time can.
    """
    steps = (after - before) % _WRAP
    return steps + max(0, round((expected - steps) / _WRAP)) * _WRAP


class Stream:
    """Samples of one start-up, in order; packets of ``batch`` of them, fewer where the status changes or some are lost.

    ``sequence`` goes on from ``first`` by one a period, whether the sample came or was lost.
    """

    def __init__(self, scale: FtCounts, mount: Mount, pace: Pace, batch: int, first: int, after_ns: int) -> None:
        """``after_ns``: no sample has a time before or at it."""
        if not 1 <= batch <= 64:
            raise SettingError(f"batch: expected 1 to 64 samples a packet, got {batch}")
        self.lost = 0
        """Samples that were missed."""
        self.taken = 0
        self.sequence = first
        """Number of the newest sample seen."""
        self.t_ns = after_ns
        """Time of the newest sample seen."""
        self.loads: tuple[Force, Torque] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        """The newest load [N, N m]."""
        self._scale, self._mount, self._pace, self._batch = scale, mount, pace, batch
        self._counter: int | None = None
        self._step_t_ns = 0
        self._phase = 0
        self._pending: list[tuple[Force, Torque]] = []
        self._status = 0

    def take(self, collected: Collected, began_ns: int) -> Iterator[FtPacket]:
        """Give the packets that are full with what was collected by a call that began at ``began_ns``."""
        samples = collected.samples
        if not samples:
            return
        newest_ns = began_ns + round(collected.newest_s * NS)
        newest = samples[-1].counter
        for sample in samples:
            behind = (newest - sample.counter) % _WRAP
            yield from self._step(sample, newest_ns - behind * self._pace.step_ns)

    def flush(self) -> Iterator[FtPacket]:
        """Give what waits for its packet to be full."""
        if self._pending:
            forces, torques = zip(*self._pending, strict=True)
            yield FtPacket(
                sequence=self.sequence,
                t_ns=self.t_ns,
                period_ns=self._pace.period_ns,
                status=self._status,
                force_n=forces,
                torque_nm=torques,
            )
            self._pending.clear()

    def _step(self, sample: Sample, t_ns: int) -> Iterator[FtPacket]:
        steps = 1
        if self._counter is not None:
            expected = (t_ns - self._step_t_ns) // self._pace.step_ns
            steps = steps_between(self._counter, sample.counter, expected)
        if steps == 0:
            return  # the same sample once more
        self._counter, self._step_t_ns = sample.counter, t_ns
        if steps > 1:
            yield from self.flush()
        # A missed step is a lost sample only where a sample was due.
        due, self._phase = divmod(self._phase + steps, self._pace.every)
        missed = due - 1 if due and self._phase == 0 else due
        self.lost += missed
        self.sequence += missed
        if due == missed:
            return
        status = status_of(sample.warnings, sample.errors)
        changed = status != self._status
        if changed:
            yield from self.flush()
        self._status = status
        self.sequence += 1
        self.taken += 1
        # Neither may a clock's correction take a sample's time back.
        self.t_ns = max(self.t_ns + 1, t_ns)
        self.loads = self._mount.to_tool(*self._scale.read(sample.counts))
        self._pending.append(self.loads)
        if changed or len(self._pending) >= self._batch:
            yield from self.flush()
