"""The UR arm on the bus: motions as of every arm (``services.bus.robot``), and its wrist as a sensor.

What a person or the safety system has stopped moves again only after ``treenail resume``, be the arm an emulated one or
not. Where the settings allow it, that also unlocks a protective stop or powers the arm: nobody but who says it does.
"""

from __future__ import annotations

import time
from functools import partial

from services.bus.answers import Asked, Request
from services.bus.robot import Manner, RobotShell
from services.bus.service import Options, Service
from services.robot_ur.at_arms_length import DistantClient
from services.robot_ur.link import Cause, Link
from services.robot_ur.motion import Arm, Script, shown
from services.robot_ur.settings import Settings
from services.robot_ur.states import State
from services.robot_ur.wrist import Wrist
from services.rules.ft_counts import FtCounts
from services.rules.hold import StoppedError
from services.rules.motions import ArmError
from services.wire.keys import FT
from services.wire.messages import Experiment, FtPacket, Resume

_LOOKS = 3
"""Looks for a packet in the time between two."""
RESUME_S = 1.5
"""How long a request to resume waits for the arm to become ready."""


def serve(options: Options, settings: Settings) -> None:
    """Run the service until it is stopped."""
    with Service("robot_ur", options) as service:
        service.claim()
        arm = Arm(settings)
        shell: UrShell
        link = Link(
            lambda: DistantClient(settings),
            arm,
            settings,
            lambda state: shell.on_state(state),
            lambda *why: shell.on_lost(*why),
        )
        shell = UrShell(service, link, arm, settings)
        if shell.load():
            shell.serve()


class UrShell(RobotShell[Script]):
    """The shell of every arm, with a sensor in its wrist."""

    def __init__(self, service: Service, link: Link, arm: Arm, settings: Settings) -> None:
        super().__init__(
            service,
            link,
            arm,
            Manner(
                settings.settle_s,
                settings.oldest_s,
                settings.by_itself,
                own_sensor=settings.wrist != "none",
                idle_s=1.0 / (_LOOKS * settings.rate_hz),
            ),
        )
        self._ur, self._settings = link, settings
        self._wrist = None if settings.wrist == "none" else Wrist(settings.wrist, settings.mount, settings.rate_hz)
        self._publish = None if self._wrist is None else service.publisher(FT, FtPacket)
        self._resuming: list[tuple[Asked, Resume, float]] = []
        """Who waits for the arm to become ready, and until when."""
        self._asks_where = False

    def take_up(self, experiment: Experiment) -> None:
        """See RobotShell; a definition may read its sensor in counts."""
        super().take_up(experiment)
        sensor = experiment.definition.sensor
        if self._wrist is not None:
            scales = (sensor.full_scale_n,) * 3 + (sensor.full_scale_dnm,) * 3
            self._wrist.counts = FtCounts("1", scales) if sensor.full_scale_n else None

    def pump(self) -> None:
        """See RobotShell."""
        super().pump()
        if self._resuming:
            self._resume_waiting()

    def on_state(self, state: State) -> None:
        """Take a packet of the controller: what the wrist feels is published, and felt by the guard at once."""
        if self._settings.start is None and not self._asks_where:
            self._asks_where = True
            self._service.log.warning("no --start; the arm stands at %s", shown(state.pose))
        wrist = self._wrist
        if wrist is None:
            return
        lost = wrist.lost
        packet = wrist.take(state, time.time_ns())
        self._say(packet)
        if wrist.lost > lost:
            self._service.refused["LostSamples"] += wrist.lost - lost
            self._service.complain(f"wrist: {wrist.lost} packets lost since the start", topic="lost")

    def on_lost(self, error: ArmError, cause: Cause) -> None:
        """Take note of a fault. A stop by a person or a safety device holds any arm, also an emulated one."""
        if cause is Cause.LINE and self._wrist is not None:
            self._say(self._wrist.gone(time.time_ns()))
            self._wrist.begin()
        self.lost(error)
        if cause is Cause.SAFETY:
            self.hold.insist(str(error), time.time_ns())
        elif self._settings.by_itself:
            self._ur.allow()

    def arrived_ns(self) -> int:
        """See RobotShell. Sensor and arm have one clock here, and one packet shows both arrival and force."""
        if self._wrist is None:
            return super().arrived_ns()
        return self._wrist.t_ns + round(1e9 * self._settings.settle_s)

    def on_home(self, asked: Asked, request: Request) -> None:
        """See RobotShell; an arm that is held says first why it could not move anyway."""
        if self.hold.held and not self._ur.ready:
            raise StoppedError(f"{self._ur.trouble}; and then `treenail resume`")
        super().on_home(asked, request)

    def on_resume(self, asked: Asked, request: Request) -> None:
        """See RobotShell; recovers the arm as far as the settings allow, and waits a moment for it."""
        if not request.payload or self._ur.ready:
            super().on_resume(asked, request)
            return
        resume = request.message(Resume)
        self._ur.recover()
        self._resuming.append((asked, resume, time.monotonic() + RESUME_S))

    # -- details -----------------------------------------------------------------------------------------------------

    def _resume_waiting(self) -> None:
        waiting, self._resuming = self._resuming, []
        for asked, resume, by_s in waiting:
            if self._ur.ready:
                self._service.answering(asked, partial(self._reply, asked, resume))
            elif time.monotonic() > by_s:
                asked.refuse(
                    ArmError(f"resume: the arm is not ready yet, say it again in a moment: {self._ur.trouble}")
                )
            else:
                self._resuming.append((asked, resume, by_s))

    def _reply(self, asked: Asked, resume: Resume) -> None:
        asked.reply(self.resume(resume))

    def _say(self, packet: FtPacket) -> None:
        if self._publish is not None:
            self._publish(packet)
        self._service.handled += 1
        self.feel(packet)
