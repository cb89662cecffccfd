"""From the controller's packets to what the wrist feels, in the tool frame, with numbers and times of a sensor. Pure.

Times are the controller's own, put where our time of day was when the connection began: they go on evenly, however late
a packet comes here. A definition that reads its sensor in counts (``sensor.full_scale_n``) gets the nearest counts.
"""

from __future__ import annotations

from services.robot_ur.settings import Wrist as Source
from services.robot_ur.states import State
from services.rules.ft_counts import FtCounts
from services.rules.mount import Mount
from services.rules.window import one_sample
from services.wire.messages import Force, FtPacket, Torque

NS = 1_000_000_000
SATURATED, LOST = 1, 4
"""Bits of ``FtPacket.status``."""
JUMP_S = 0.5
"""How far the controller's clock may be ahead of where it should be."""


class Wrist:
    """The sensor in the wrist, or the arm's own estimate of it."""

    def __init__(self, source: Source, mount: Mount, rate_hz: float) -> None:
        self.counts: FtCounts | None = None
        """The scale that the definition reads its sensor in; None for none."""
        self.lost = 0
        """Packets that were missed."""
        self._source, self._mount = source, mount
        self._period_ns = round(NS / rate_hz)
        self._ahead_ns: int | None = None
        self._sequence = self._t_ns = 0
        self._load: tuple[Force, Torque] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    @property
    def t_ns(self) -> int:
        """Time of the newest packet."""
        return self._t_ns

    def begin(self) -> None:
        """Begin with another connection, whose clock may be another one."""
        self._ahead_ns = None

    def take(self, state: State, day_ns: int) -> FtPacket:
        """Return what is felt in a state that came at our time of day."""
        there_ns = round(state.t_s * NS)
        if self._ahead_ns is None:
            self._ahead_ns = max(day_ns, self._t_ns + self._period_ns) - there_ns
            self._sequence = max(self._sequence + 1, (there_ns + self._ahead_ns) // self._period_ns)
        else:
            missed = max(1, round((there_ns + self._ahead_ns - self._t_ns) / self._period_ns))
            self.lost += missed - 1
            self._sequence += missed
        self._t_ns = there_ns + self._ahead_ns
        force_n, torque_nm, saturated = self._felt(state)
        self._load = force_n, torque_nm
        return self._packet(SATURATED if saturated else 0)

    def gone(self, day_ns: int) -> FtPacket:
        """Return what tells everybody that nothing is felt any more: the load is the one felt last."""
        self._sequence += 1
        self._t_ns = max(self._t_ns + 1, day_ns)
        return self._packet(LOST)

    def _felt(self, state: State) -> tuple[Force, Torque, bool]:
        if self._source == "raw":
            fx, fy, fz, mx, my, mz = state.raw
            force_n, torque_nm = (fx, fy, fz), (mx, my, mz)
        else:
            force_n, torque_nm = state.pose.in_tool(state.force[:3]), state.pose.in_tool(state.force[3:])
        force_n, torque_nm = self._mount.to_tool(force_n, torque_nm)
        if self.counts is None:
            return force_n, torque_nm, False
        return self.counts.quantised(force_n, torque_nm)

    def _packet(self, status: int) -> FtPacket:
        return one_sample(self._sequence, self._t_ns, self._period_ns, status, self._load)


class ControllerClock:
    """Whether the controller's clock goes on evenly beside ours."""

    def __init__(self) -> None:
        self._last_s: float | None = None
        self._ahead_s = 0.0
        """Of ours, by the packet that was least delayed."""

    def begin(self) -> None:
        """Begin with another connection."""
        self._last_s = None

    def complaint(self, t_s: float, now_s: float) -> str | None:
        """Return how the clock has jumped with a packet that came at our time ``now_s``, or None."""
        last_s, self._last_s = self._last_s, t_s
        ahead_s = t_s - now_s
        if last_s is None:
            self._ahead_s = ahead_s
            return None
        jump_s = t_s - last_s if t_s < last_s else ahead_s - self._ahead_s
        if t_s < last_s or jump_s > JUMP_S:
            return f"robot: expected the controller's clock to go on evenly, it jumped by {jump_s:+.3f} s"
        self._ahead_s = max(self._ahead_s, ahead_s)
        return None
