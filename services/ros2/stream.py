"""From samples of a topic to packets: what is stale, unordered, repeated or somebody else's never passes. Pure.

A sample's time is the stamp that its driver gave it, put on our time of day where the least delayed sample of the last
second says. What cannot be believed raises an error; the service says so to the robot, and counts it.
"""

from __future__ import annotations

from services.ros2.attachment import Attachment
from services.ros2.errors import ClockError, FrameError, SampleError
from services.ros2.messages import Wrench
from services.rules.mount import Mount
from services.rules.senses import LeastDelay
from services.rules.window import one_sample
from services.wire.messages import Force, FtPacket, Torque

NS = 1_000_000_000
LOST, CHANGED, NOT_ZEROED = 4, 8, 16
"""Bits of ``FtPacket.status``."""
JUMP_S = 1.0
"""How far a stamp may be ahead of where it should be, by our clock."""


class Stream:
    """The samples of one publisher."""

    def __init__(self, frame: str, rate_hz: float, mount: Mount, oldest_s: float) -> None:
        """``oldest_s``: how much later than the least delayed of the last second a sample may come."""
        self.lost = self.taken = 0
        self._frame, self._mount = frame, mount
        self._period_ns, self._oldest_ns = round(NS / rate_hz), round(oldest_s * NS)
        self._delay = LeastDelay()
        self._gid: bytes | None = None
        self._before: bytes | None = None
        """Who published before the stream was last begun."""
        self._number = 0
        """Of the publisher's newest sample."""
        self._stamp_ns: int | None = None
        self._sequence = self._t_ns = 0
        self._load: tuple[Force, Torque] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def begin(self) -> None:
        """Take whoever comes next for the publisher, with a clock of its own."""
        self._before = self._gid or self._before
        self._gid = self._stamp_ns = None
        self._number = 0
        self._delay.forget()

    def take(self, wrench: Wrench, attached: Attachment, came_ns: int) -> FtPacket:
        """Return the packet of a sample that came at a time of day without jumps.

        Raises SampleError for one of another publisher, unordered, repeated or stale; FrameError; ClockError, after
        which the clock is another one.
        """
        self._check_order(attached)
        if wrench.frame != self._frame:
            raise FrameError(f"frame: expected {self._frame!r} (--frame), got {wrench.frame[:40]!r}")
        step = attached.sequence - self._number if self._gid is not None else 1
        self._check_clock(wrench.t_ns, came_ns)
        self._gid, self._number = attached.gid, attached.sequence
        self.lost += step - 1
        self.taken += 1
        first = came_ns // self._period_ns if self._sequence == 0 else 0
        self._sequence = max(self._sequence + step, first)
        self._t_ns = max(self._t_ns + 1, min(came_ns, wrench.t_ns - (self._delay.there_ns(0) or 0)))
        self._load = self._mount.to_tool(wrench.force_n, wrench.torque_nm)
        return self._packet(0)

    def comes_from_another(self, attached: Attachment) -> bool:
        """Return whether this is the first sample of another publisher than the one before: another sensor, maybe."""
        return self._gid is None and self._before is not None and self._before != attached.gid

    def say(self, status: int, now_ns: int) -> FtPacket:
        """Return a status without a sample: the load is the one felt last."""
        self._sequence = max(self._sequence + 1, now_ns // self._period_ns if self._sequence == 0 else 0)
        self._t_ns = max(self._t_ns + 1, now_ns)
        return self._packet(status)

    def _check_order(self, attached: Attachment) -> None:
        if self._gid is None:
            return
        if attached.gid != self._gid:
            raise SampleError("publisher: expected one on the topic, got a sample of another one; end one of them")
        if attached.sequence <= self._number:
            kind = "repeated" if attached.sequence == self._number else "unordered"
            raise SampleError(f"sample: expected number {self._number + 1} or later, got {attached.sequence}: {kind}")

    def _check_clock(self, stamp_ns: int, came_ns: int) -> None:
        if stamp_ns == 0:
            raise SampleError("stamp: expected the time of the sample in its header, got 0; the driver must give one")
        last_ns, there_ns = self._stamp_ns, self._delay.there_ns(came_ns)
        if last_ns is not None and there_ns is not None:
            if stamp_ns == last_ns:
                raise SampleError(f"stamp: expected one after {last_ns} ns, got the same: repeated")
            ahead_ns = stamp_ns - there_ns
            if stamp_ns < last_ns or ahead_ns > JUMP_S * NS:
                jump_s = (stamp_ns - last_ns if stamp_ns < last_ns else ahead_ns) / NS
                self.begin()
                raise ClockError(f"clock: expected the driver's to go on evenly, it jumped by {jump_s:+.3f} s")
            if -ahead_ns > self._oldest_ns:
                raise SampleError(
                    f"sample: expected one of at most {self._oldest_ns / NS:g} s ago, got one of {-ahead_ns / NS:.3f} s"
                )
        self._stamp_ns = stamp_ns
        self._delay.heard(stamp_ns, came_ns)

    def _packet(self, status: int) -> FtPacket:
        return one_sample(self._sequence, self._t_ns, self._period_ns, status, self._load)
