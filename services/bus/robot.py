"""A robot on the bus: ``home`` and ``move`` as ``services.sim`` answers them, made by an arm behind some driver.

A new arm brings a ``Link``, which is its driver, and ``Motions``, which are its scripts; all else is here, once: order,
guard, senses, one motion at a time, and the latch after a stop.

The loop never waits for the arm: queries, F/T samples and heartbeats go on while a motion is under way. The one motion
that is under way may be asked for again, and everybody who did gets its answer; any other is refused.

Nothing moves before somebody has asked for ``resume``, nor after a trouble of arm, line or sensor until he does again
(``services.rules.hold``).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from services.bus.answers import Asked, Request
from services.bus.service import Service
from services.rules.arrival import SensorClock
from services.rules.guard import OLDEST_S, increment_of
from services.rules.hold import Hold
from services.rules.motions import ArmError, BusyError, DeadSensorError, Robot, require_tool_at_tip
from services.wire.actions import Increment
from services.wire.errors import RefusedError
from services.wire.keys import FT, HOME, MOVE, RESUME, SENSORS
from services.wire.messages import Experiment, FtPacket, Home, Move, Resume, Stop

_BUSY_S = 0.005
_EVENTS = 64
S = TypeVar("S")
S_contra = TypeVar("S_contra", contravariant=True)
S_co = TypeVar("S_co", covariant=True)


class Link(Protocol[S_contra]):
    """The driver of one arm: carries scripts out, one at a time. Nothing in it blocks."""

    @property
    def ready(self) -> bool:
        """Whether a script can be run, now or after the one under way."""

    @property
    def busy(self) -> bool:
        """Whether a script is under way."""

    @property
    def trouble(self) -> str:
        """Why it is not ready, or what went wrong last."""

    def run(self, script: S_contra, then: Callable[[Increment | ArmError], None]) -> None:
        """Carry a script out and call ``then`` with its result, later, once. Raises ArmError, BusyError."""

    def give_up(self, error: ArmError) -> None:
        """Have the arm stop, and end the script under way with an error."""

    def pump(self, timeout_s: float) -> None:
        """Do what is to be done, waiting at most so long [s] for the arm to say something."""

    def close(self) -> None:
        """Have the arm stop what may be moving, and let go of it."""


class Motions(Protocol[S_co]):
    """What an arm does for the two motions there are, as scripts of its own."""

    def home(self, home: Home) -> S_co:
        """Go to the start pose of an episode. Raises ArmError when it cannot even be begun."""

    def move(self, increment: Increment, episode: int, step: int) -> S_co:
        """Make one increment; what it ends with is what was applied."""


@dataclass(frozen=True)
class Manner:
    """How an arm is treated."""

    settle_s: float
    """From arrival to the first F/T sample that counts."""
    oldest_s: float = OLDEST_S
    """Age above which an F/T sample says nothing about now."""
    by_itself: bool = False
    """An emulated arm: it moves without being told."""
    own_sensor: bool = False
    """What is felt comes by ``feel`` alone, not from the bus."""
    idle_s: float = 0.02
    """How long the driver may go without working."""


class RobotShell(Generic[S]):
    """Answers motions once they are made."""

    def __init__(self, service: Service, link: Link[S], motions: Motions[S], manner: Manner) -> None:
        """``link`` tells ``lost`` of each fault."""
        self._service, self._link, self._motions, self._manner = service, link, motions, manner
        self._clock = SensorClock()
        self.hold = Hold(manner.by_itself, time.time_ns())
        self._motion: Home | Move | None = None
        """Under way."""
        self._asked: list[Asked] = []
        """Who waits for it."""
        self.robot: Robot | None = None
        """None until it is known what runs."""
        self._numb: str | None = None
        """Why the sensor was not to be believed when it was looked at last."""
        self._good = False
        """Whether its samples could be used then."""

    def load(self) -> bool:
        """Learn from the task what runs; False when stopped meanwhile."""
        experiment = self._service.wait_for("task (no experiment)", self._service.ask_experiment)
        if experiment is not None:
            self.take_up(experiment)
        return experiment is not None

    def serve(self) -> None:
        """Answer and work until stopped; the service is alive once the arm has been ready for the first time."""
        service, link = self._service, self._link
        if not self._manner.own_sensor:  # it would hear itself
            service.subscribe(FT, FtPacket, self.feel, *(name for name in SENSORS if name != service.name))
        service.answer_later(HOME, self.on_home)
        service.answer_later(MOVE, self.on_move)
        service.answer_later(RESUME, self.on_resume)
        alive = False
        while not service.stopping:
            self.watch_sensor()
            if link.ready and not alive:
                alive = True
                service.ready()
            self._show_phase()
            self.pump()
            waiting = link.busy or not link.ready
            service.work(0.0 if waiting else self._manner.idle_s)
            for _ in range(_EVENTS):
                if not service.work(0.0):
                    break
        for asked in self._asked:
            asked.refuse(RefusedError(f"{service.name}: expected to go on, but is stopping"))
        link.close()

    def pump(self) -> None:
        """Let the driver work."""
        link = self._link
        link.pump(_BUSY_S if link.busy or not link.ready else 0.0)

    def on_home(self, asked: Asked, request: Request) -> None:
        """Begin ``home``; another run's is taken when the task says that this is what runs now."""
        home = request.message(Home)
        if self._is_under_way(asked, home):
            return
        self.hold.check(time.monotonic())
        if home.run != self._service.run:
            experiment = self._service.ask_experiment()
            if experiment is not None and experiment.run == home.run:
                self.take_up(experiment)
        self._moving.home(home)
        self._begin(asked, home, self._motions.home(home))

    def on_move(self, asked: Asked, request: Request) -> None:
        """Begin ``move``, or answer the last one again."""
        move = request.message(Move)
        if self._is_under_way(asked, move):
            return
        self.hold.check(time.monotonic())
        robot, now_ns = self._moving, time.monotonic_ns()
        done = robot.again(move, now_ns)
        if done is not None:
            asked.reply(done)
            return
        try:
            robot.move(move, now_ns)
        except DeadSensorError as error:
            # Once the sensor is mended, the episode begins anew.
            robot.lost()
            self.hold.insist(str(error), time.time_ns())
            raise
        self._begin(asked, move, self._motions.move(increment_of(move), move.episode, move.step))

    def on_resume(self, asked: Asked, request: Request) -> None:
        """Let the arm move again, or say what holds it. Raises StoppedError, ArmError."""
        if not request.payload:
            asked.reply(self.hold.stop)
            return
        asked.reply(self.resume(request.message(Resume)))

    def resume(self, resume: Resume) -> Stop:
        """Let the arm move again; return what holds it then: nothing. Raises StoppedError, ArmError."""
        why = self.hold.stop.why
        if not self._link.ready:
            raise ArmError(f"resume: expected the controller to be ready, it is not: {self._link.trouble}")
        stop = self.hold.resume(resume)
        if self.robot is not None:
            self.robot.resumed()
        if why:
            self._service.log.warning("somebody lets the arm move again after: %s", why)
        return stop

    def lost(self, error: ArmError) -> None:
        """Take note of a fault: nobody knows where the arm is."""
        if self.robot is not None:
            self.robot.lost()
        self.hold.trouble(str(error), time.time_ns())
        self._service.refuse(error)

    def feel(self, packet: FtPacket) -> None:
        """Take an F/T packet."""
        robot, now_ns = self.robot, time.monotonic_ns()
        if robot is None:
            return
        taken = robot.feel(packet, now_ns)
        if taken == "old":
            self._service.complain(f"sensor: expected newer samples, got number {packet.sequence} again", topic="old")
            return
        self._clock.heard(packet.t_ns, now_ns)
        if taken == "other":
            self._service.log.warning("sensor: its clock or its numbers went back: taken over as another one")
            if self._motion is None:
                robot.arrived(self.arrived_ns())
        if isinstance(self._motion, Move):  # home is the way out of a high force
            complaint = robot.pressing(packet)
            if complaint is not None:
                self._link.give_up(ArmError(complaint))

    def watch_sensor(self) -> None:
        """Hold the arm when a sensor fails that was good, or is not to be believed any more."""
        robot = self.robot
        if robot is None:
            return
        numb = robot.numb()
        if numb is not None and numb != self._numb:
            robot.lost()  # the episode begins anew, with a zero of its own
            self.hold.insist(numb, time.time_ns())
        self._numb = numb
        complaint = robot.sensing(time.monotonic_ns())
        if complaint is not None and self._good and numb is None:
            self.hold.trouble(complaint, time.time_ns())
        self._good = complaint is None

    def arrived_ns(self) -> int:
        """Return from when on samples show the motion that has just ended, in the sensor's time."""
        settle_ns = round(1e9 * self._manner.settle_s)
        return self._clock.arrived(time.monotonic_ns(), time.time_ns(), settle_ns)

    def take_up(self, experiment: Experiment) -> None:
        """Take up what runs. Raises GuardError for what no real arm can do."""
        require_tool_at_tip(experiment.definition)
        self.robot = Robot(experiment.definition, experiment.run, self._manner.oldest_s)
        self._service.run = experiment.run

    # -- details -----------------------------------------------------------------------------------------------------

    @property
    def _moving(self) -> Robot:
        """What answers motions. Raises ArmError before it is known what runs."""
        if self.robot is None:
            raise ArmError("robot: expected to know what runs, got no answer of the task yet")
        return self.robot

    def _is_under_way(self, asked: Asked, motion: Home | Move) -> bool:
        """Return whether this motion is being made; who asked waits for it then. Raises BusyError for another one."""
        if self._motion is None:
            return False
        if motion != self._motion:
            raise BusyError(f"robot: expected to be asked for one motion at a time, {_name(self._motion)} is under way")
        self._asked = [*[request for request in self._asked if request.open][-_EVENTS:], asked]
        return True

    def _begin(self, asked: Asked, motion: Home | Move, script: S) -> None:
        self._motion, self._asked = motion, [asked]
        try:
            self._link.run(script, self._on_end)
        except RefusedError:
            self._motion, self._asked = None, []
            raise

    def _on_end(self, result: Increment | ArmError) -> None:
        motion, self._motion = self._motion, None
        waiting, self._asked = self._asked, []
        if isinstance(result, ArmError):
            self.hold.failed(str(result), time.time_ns(), time.monotonic())
        if isinstance(result, ArmError) or motion is None:
            for asked in waiting:
                asked.refuse(result if isinstance(result, ArmError) else ArmError("robot: nothing was under way"))
            return
        self.hold.succeeded()
        t_ns, robot = self.arrived_ns(), self._moving
        answer = robot.homed(motion, t_ns) if isinstance(motion, Home) else robot.moved(motion, result, t_ns)
        for asked in waiting:
            asked.reply(answer)

    def _show_phase(self) -> None:
        service = self._service
        if not self._link.ready:
            service.phase = f"waiting for the controller: {self._link.trouble}"[:200]
        elif self._motion is not None:
            service.phase = f"making {_name(self._motion)}"
        elif self.hold.held:
            service.phase = f"stopped: {self.hold.words()}"[:200]
        else:
            complaint = None if self.robot is None else self.robot.sensing(time.monotonic_ns())
            service.phase = "running" if complaint is None else f"stands: {complaint}"[:200]


def _name(motion: Home | Move) -> str:
    return f"home of episode {motion.episode}" if isinstance(motion, Home) else f"step {motion.step}"
