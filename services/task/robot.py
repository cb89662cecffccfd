"""The robot as the task sees it: motions are asked for, answered, and felt; a robot that died is brought back."""

from __future__ import annotations

import time
from collections.abc import Callable

from services.bus.service import Service
from services.rules.forces import TareError
from services.rules.senses import Freshness
from services.rules.window import ANEW, Windows
from services.wire.definition import Sensor
from services.wire.keys import FT, HOME, MOVE, SENSORS
from services.wire.messages import FtPacket, Home, Move, Moved, Refusal

FELT_WITHIN_S = 0.5
"""Besides twice the time of a window."""
SLOWEST_HZ = 100
"""Of a sensor whose rate is not stated."""
RETRY_S = 0.05
STOPPED_S = 0.25
"""Pause before a motion is asked for again that somebody has to let the arm make."""


class Robot:
    """Homes and moves, one at a time, each followed by the F/T samples felt after it."""

    def __init__(self, service: Service, sensor: Sensor, tare_again: Callable[[FtPacket], None]) -> None:
        """``tare_again`` takes samples at the start pose that a robot was brought back to; it may raise TareError."""
        self._service = service
        self._ask_home = service.asker(HOME, Moved)
        self._ask_move = service.asker(MOVE, Moved)
        self._motions: list[Home | Move] = []
        self._windows = Windows(sensor)
        self._tares, self._tare_again = sensor.tare_samples > 0, tare_again
        self._anew = False
        """Whether the sensor began anew since its zero was taken."""
        samples = max(sensor.window, sensor.tare_samples)
        self._broken = False
        """Whether a stream began anew since the newest motion was asked for. It may be another sensor's, on an arm that
        lost its place with it: nothing that it shows counts before the motion was asked for once more."""
        self._within_s = FELT_WITHIN_S + 2.0 * (samples - 1) / (sensor.rate_hz or SLOWEST_HZ)
        self._fresh = Freshness()
        self._pause_s = RETRY_S
        # A sample comes just before the answer to the motion that it was felt after: one of them is enough to wake us.
        service.subscribe(FT, FtPacket, self._on_ft, *SENSORS, quietly=True)

    def go(self, motion: Home | Move) -> tuple[Moved, FtPacket] | None:
        """Make a motion and return what was applied, and the samples of the window after it.

        Tries as long as it takes; None only when stopped.
        """
        if isinstance(motion, Home):
            self._motions.clear()
        self._motions.append(motion)
        service = self._service
        while not service.stopping:
            done = self._try(motion)
            if done is not None:
                service.phase = "running"
                return done
            service.complain(service.phase)
            service.work_until(lambda: False, self._pause_s)
        return None

    def wait(self, why: str) -> None:
        """Say why nothing moves on, and wait a moment."""
        service = self._service
        service.phase = f"stopped: {why}"[:200]
        service.complain(service.phase)
        service.work_until(lambda: False, STOPPED_S)

    def _try(self, motion: Home | Move) -> tuple[Moved, FtPacket] | None:
        service = self._service
        answer = self._ask(motion)
        if isinstance(answer, Refusal) and answer.reason == "out_of_order":
            try:
                answer = self._ask(motion) if self._bring_back() else answer
            except TareError as error:
                service.phase = f"stopped: {error}"[:200]
                return None
        stopped = isinstance(answer, Refusal) and answer.reason == "stopped"
        self._pause_s = STOPPED_S if stopped else RETRY_S
        if answer is None:
            service.phase = "waiting for robot (no answer to a motion)"
            return None
        if isinstance(answer, Refusal):
            service.phase = f"stopped: {answer.message}"[:200]
            return None
        felt = self._feel(answer.arrived_t_ns)
        if felt is None:
            service.phase = f"waiting for sensor ({self._windows.why or 'no F/T sample after a motion'})"[:200]
            return None
        return answer, felt

    def _feel(self, arrived_t_ns: int) -> FtPacket | None:
        """Return the samples of the window after an arrival, or None when they do not come."""
        if self._anew:
            self._windows.why = "it began anew since its zero was taken"
            return None
        felt: FtPacket | None = None

        def all_there() -> bool:
            nonlocal felt
            felt = None if self._broken else self._windows.after(arrived_t_ns)
            return felt is not None or self._broken

        self._service.work_until(all_there, self._within_s, heed_quiet=True)
        return felt

    def _ask(self, motion: Home | Move) -> Moved | Refusal | None:
        at_home = isinstance(motion, Home)
        self._service.work_until(lambda: True, 0.0)  # what was felt before belongs to the motion before
        self._windows.begin(at_home=at_home)
        self._broken = False
        self._anew = self._anew and not at_home
        return self._ask_home(motion) if isinstance(motion, Home) else self._ask_move(motion)

    def _bring_back(self) -> bool:
        """Repeat the episode's motions but the last, for a robot that lost its place; True when it has them all.

        Raises TareError.
        """
        self._service.log.warning("robot lost its place: repeating %d motions", len(self._motions) - 1)
        for motion in self._motions[:-1]:
            answer = self._ask(motion)
            if not isinstance(answer, Moved):
                return False
            # No faster than it is felt: a robot whose samples come late takes its sensor for dead.
            felt = self._feel(answer.arrived_t_ns)
            if felt is None:
                return False
            if self._tares and isinstance(motion, Home):
                self._tare_again(felt)
        return True

    def _on_ft(self, packet: FtPacket) -> None:
        """Keep a packet; of a stream only one that is new."""
        taken = "new" if packet.period_ns == 0 else self._fresh.take(packet, time.monotonic_ns())
        if taken != "old":
            if self._tares and (taken == "other" or packet.status & ANEW):
                self._anew = True
            if packet.period_ns and packet.status & ANEW:
                self._broken = True
            self._windows.take(packet)
