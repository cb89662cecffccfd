"""A simulator in a cell of its own, whose peg an emulated arm moves, asked over Zenoh.

What an emulated controller is told is where to go, not which episode and step of a run that is; so it is worked out:

    to the start location      the arm is free, and its next step goes from there to the start pose: ``home``
    a step after ``home``      the next ``move``, with the numbers on the grid of the emulator
    a step back, or elsewhere  the arm leaves the simulated world until it comes by the start location again

Where episode and step are told they count; otherwise episodes are numbered as they come. A simulator with noise draws
it by these numbers, so that only runs that tell them are the same as those without an arm in between.

The simulator learns what to simulate from its own cell's task, and there is none: the question is passed on to the cell
that the run is in. A simulator that was started anew gets the episode's motions again.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import TypeAlias

import zenoh
from zenoh.handlers import Callback

from services.bus.answers import Asked, answer_in, to_first
from services.bus.follower import FELT, SHOWN
from services.wire.actions import Increment
from services.wire.codec import decode, encode, encoding_of
from services.wire.errors import NoAnswerError, TreenailError
from services.wire.keys import EXPERIMENT, FT, HOME, MOVE, Keys
from services.wire.messages import Experiment, FtPacket, Home, Message, Move, Moved, Refusal

_ANSWER_S = 2.0
_TRIES, _PAUSE_S = 5, 0.1
_WITHDRAWN_MM = 5.0
"""A step so far back is no action, but the way home."""
_OnSample: TypeAlias = "Callback[zenoh.Sample]"
_OnQuery: TypeAlias = "Callback[zenoh.Query]"


class WorldFault(Exception):
    """A motion was not made; the text is what a controller may say."""


class World:
    """A simulator in another cell, asked over Zenoh."""

    def __init__(
        self, session: zenoh.Session, cell: Keys, world: Keys, sensor_s: float, patience_s: float = 0.0
    ) -> None:
        """``cell`` has the run, ``world`` the simulator; an emulated sensor has ``sensor_s`` to show a motion.

        A simulator that is started again has ``patience_s`` for that.
        """
        self._session, self._cell, self._world, self._sensor_s = session, cell, world, sensor_s
        self._patience_s = patience_s
        self._felt: deque[FtPacket] = deque(maxlen=64)
        self._came = threading.Condition()
        key = world.of(EXPERIMENT)
        on_ft: _OnSample = Callback(self._on_ft, indirect=False)
        on_query: _OnQuery = Callback(lambda query: self._pass_on(Asked(query, key, ())), indirect=False)
        on_felt: _OnQuery = Callback(self._on_felt, indirect=False)
        self._declared = (
            session.declare_subscriber(world.of(FT), on_ft),
            session.declare_queryable(key, on_query),
            session.declare_queryable(world.of(FELT), on_felt),
        )

    def run(self) -> str:
        """Return the run that the cell's task is in. Raises WorldFault."""
        answer = self._ask(self._cell.of(EXPERIMENT), Experiment, None)
        if not isinstance(answer, Experiment):
            raise WorldFault("No experiment runs")
        return answer.run

    def make(self, motion: Home | Move) -> Moved | Refusal:
        """Have a motion made, and wait until the sensor shows it. Raises WorldFault."""
        name = HOME if isinstance(motion, Home) else MOVE
        tries, deadline = 0, time.monotonic() + self._patience_s
        while tries < _TRIES or time.monotonic() < deadline:
            if tries >= _TRIES:
                time.sleep(_PAUSE_S)
            tries += 1
            answer = self._ask(self._world.of(name), Moved, motion)
            if isinstance(answer, Moved):
                if self._sensor_s > 0.0:
                    self._wait_shown(answer)
                return answer
            if isinstance(answer, Refusal):
                return answer
        raise WorldFault("Servo does not answer")

    def felt(self, moved: Moved, within_s: float = _ANSWER_S) -> FtPacket:
        """Return what is felt after a motion. Raises WorldFault."""

        def felt() -> FtPacket | None:
            return next((packet for packet in reversed(self._felt) if packet.t_ns == moved.arrived_t_ns), None)

        with self._came:
            self._came.wait_for(lambda: felt() is not None, within_s)
            packet = felt()
        if packet is None:
            raise WorldFault("Sensor does not feel the motion")
        return packet

    def _wait_shown(self, moved: Moved) -> None:
        key = f"{self._world.of(SHOWN)}?sequence={self.felt(moved, self._sensor_s).sequence}"
        if not isinstance(self._ask(key, FtPacket, None, self._sensor_s), FtPacket):
            raise WorldFault("Sensor does not show the motion")

    def _ask(
        self, key: str, kind: type[Message], message: Message | None, timeout_s: float = _ANSWER_S
    ) -> Message | None:
        payload = None if message is None else encode(message)
        encoding = None if message is None else encoding_of(type(message))
        for reply in self._session.get(key, payload=payload, encoding=encoding, timeout=timeout_s):
            try:
                answer = answer_in(reply, kind)
            except TreenailError:
                continue
            if answer is not None:
                return answer
        return None

    def _on_ft(self, sample: zenoh.Sample) -> None:
        try:
            packet = decode(FtPacket, sample.payload.to_bytes(), str(sample.encoding))
        except TreenailError:
            return  # the sensor complains of it
        with self._came:
            self._felt.append(packet)
            self._came.notify_all()

    def _on_felt(self, query: zenoh.Query) -> None:
        """Tell an emulated sensor that has just been started what there is to be felt."""
        with self._came:
            newest = self._felt[-1] if self._felt else None
        if newest is None:
            query.drop()  # type: ignore[no-untyped-call]
        else:
            Asked(query, self._world.of(FELT), ()).reply(newest)

    def _pass_on(self, asked: Asked) -> None:
        """Ask the run's cell what the simulator asked; on Zenoh's threads, so that no motion waits for it."""

        def then(answer: Experiment | Refusal | None) -> None:
            if isinstance(answer, Experiment):
                asked.reply(answer)
            else:
                asked.refuse(NoAnswerError(f"{self._cell.of(EXPERIMENT)}: expected an answer, got none"))

        try:
            asked.request()
        except TreenailError as error:
            asked.refuse(error)
            return
        self._session.get(self._cell.of(EXPERIMENT), to_first(Experiment, then, _now), timeout=_ANSWER_S)


class Peg:
    """The simulated peg at the tip of an emulated arm."""

    def __init__(self, world: World, start_height_mm: float) -> None:
        """At the taught start location the tip is ``start_height_mm`` above the mouth."""
        self._world, self._height_mm = world, start_height_mm
        self._at_start = False
        self._motions: list[Home | Move] = []
        """Of the episode under way; empty when the arm is not in the simulated world."""
        self._episodes = 0

    def step(self, increment: Increment, episode: int | None, number: int | None) -> Moved | None:
        """Make one step in the tool frame; None when it is one outside of the simulated world.

        ``episode`` and ``number`` are what the controller was told, None for nothing. Raises WorldFault.
        """
        motion: Home | Move | None = None
        if self._at_start:
            motion = self._home(increment, episode)
        elif self._motions and increment.dz_mm > -_WITHDRAWN_MM:
            motion = self._move(increment, number)
        self._at_start = False
        if motion is None:
            self._motions = []
            return None
        return self._make(motion)

    def leave(self, at_start: bool = False) -> None:
        """Be elsewhere; ``at_start`` for the start location."""
        self._motions, self._at_start = [], at_start

    def _home(self, increment: Increment, episode: int | None) -> Home:
        x, y, z, rx, ry, rz = increment
        number = self._episodes if episode is None else episode
        self._episodes = number + 1
        z = round(z - self._height_mm, 9) + 0.0
        return Home(run=self._world.run(), episode=number, x_mm=x, y_mm=y, z_mm=z, rx_deg=rx, ry_deg=ry, rz_deg=rz)

    def _move(self, increment: Increment, number: int | None) -> Move:
        first, last = self._motions[0], self._motions[-1]
        following = (last.step if isinstance(last, Move) else 0) + 1
        step = following if number is None else number
        return Move(run=first.run, episode=first.episode, step=step, **increment._asdict())

    def _make(self, motion: Home | Move) -> Moved:
        self._motions = [motion] if isinstance(motion, Home) else [*self._motions, motion]
        answer = self._world.make(motion)
        if isinstance(answer, Refusal) and answer.reason == "out_of_order" and isinstance(motion, Move):
            for earlier in self._motions[:-1]:
                self._world.make(earlier)
            answer = self._world.make(motion)
        if isinstance(answer, Refusal):
            self._motions = []
            raise WorldFault(f"Servo refuses: {answer.message[:60]}".replace("*", ""))
        return answer


def _now(call: Callable[..., None], argument: object) -> None:
    call(argument)
