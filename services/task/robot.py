"""The robot as the task sees it: motions are asked for, answered, and felt; a robot that died is brought back."""

from __future__ import annotations

import time
from collections import deque

from services.bus.service import Service
from services.rules.senses import Freshness
from services.wire.keys import FT, HOME, MOVE, SENSORS
from services.wire.messages import FtPacket, Home, Move, Moved, Refusal

FELT_WITHIN_S = 0.5
RETRY_S = 0.05
STOPPED_S = 0.25
"""Pause before a motion is asked for again that somebody has to let the arm make."""
KEPT = 64
"""Packets that are kept to find the one of a motion among."""


class Robot:
    """Homes and moves, one at a time, each followed by the F/T sample felt after it."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._ask_home = service.asker(HOME, Moved)
        self._ask_move = service.asker(MOVE, Moved)
        self._motions: list[Home | Move] = []
        self._felt: deque[FtPacket] = deque(maxlen=KEPT)
        """The newest packets since a motion was asked for."""
        self._fresh = Freshness()
        self._pause_s = RETRY_S
        service.subscribe(FT, FtPacket, self._on_ft, *SENSORS)

    def go(self, motion: Home | Move) -> tuple[Moved, FtPacket] | None:
        """Make a motion and return what was applied and felt; tries as long as it takes, None only when stopped."""
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

    def _try(self, motion: Home | Move) -> tuple[Moved, FtPacket] | None:
        service = self._service
        answer = self._ask(motion)
        if isinstance(answer, Refusal) and answer.reason == "out_of_order" and self._bring_back():
            answer = self._ask(motion)
        stopped = isinstance(answer, Refusal) and answer.reason == "stopped"
        self._pause_s = STOPPED_S if stopped else RETRY_S
        if answer is None:
            service.phase = "waiting for robot (no answer to a motion)"
            return None
        if isinstance(answer, Refusal):
            service.phase = f"stopped: {answer.message}"[:200]
            return None
        arrived = answer.arrived_t_ns
        service.work_until(lambda: self._felt_after(arrived) is not None, FELT_WITHIN_S)
        packet = self._felt_after(arrived)
        if packet is None:
            service.phase = "waiting for sensor (no F/T sample after a motion)"
            return None
        return answer, packet

    def _ask(self, motion: Home | Move) -> Moved | Refusal | None:
        self._felt.clear()
        return self._ask_home(motion) if isinstance(motion, Home) else self._ask_move(motion)

    def _bring_back(self) -> bool:
        """Repeat the episode's motions but the last, for a robot that lost its place; True when it has them all."""
        self._service.log.warning("robot lost its place: repeating %d motions", len(self._motions) - 1)
        return all(isinstance(self._ask(motion), Moved) for motion in self._motions[:-1])

    def _felt_after(self, arrived_t_ns: int) -> FtPacket | None:
        """Return the newest packet that a motion shows in, or None so far.

        A sample that is not one of a stream is the simulator's, of one motion, and has the time of its end. One of a
        later time is then not news but late: it was sent before we were started again and began the episode anew.
        """
        for packet in reversed(self._felt):
            if packet.t_ns == arrived_t_ns or (packet.period_ns and packet.t_ns > arrived_t_ns):
                return packet
        return None

    def _on_ft(self, packet: FtPacket) -> None:
        """Keep a packet; of a stream only one that is new."""
        if packet.period_ns == 0 or self._fresh.take(packet, time.monotonic_ns()) != "old":
            self._felt.append(packet)
