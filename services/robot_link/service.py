"""The robot link on the bus: ``home`` and ``move`` as ``services.sim`` answers them, made by a controller on a line.

The loop never waits for the controller: queries, F/T samples and heartbeats go on while a motion is under way. The one
motion that is under way may be asked for again, and everybody who did gets its answer; any other is refused.

Nothing moves before somebody has asked for ``resume``, nor after a trouble of arm, line or sensor until he does again
(``services.rules.hold``).
"""

from __future__ import annotations

import time

from services.bus.answers import Asked, Request
from services.bus.service import Options, Service
from services.robot_link.channel import Channel
from services.robot_link.errors import BusyError, LinkError
from services.robot_link.link import Link
from services.robot_link.serial_line import Line
from services.robot_link.settings import Settings
from services.robot_link.val2.dialects import DIALECTS
from services.robot_link.val2.motion import Arm, Script
from services.robot_link.val2.terminal import Terminal
from services.rules.arrival import SensorClock
from services.rules.guard import increment_of
from services.rules.hold import Hold
from services.rules.motions import DeadSensorError, Robot
from services.wire.actions import Increment
from services.wire.errors import RefusedError
from services.wire.keys import FT, HOME, MOVE, RESUME
from services.wire.messages import Experiment, FtPacket, Home, Move, Resume, Stop

_IDLE_S, _BUSY_S = 0.02, 0.005
_EVENTS = 64


def serve(options: Options, settings: Settings, channel: Channel) -> None:
    """Run the robot link until it is stopped; ``channel`` is what lies between the terminal's text and the line."""
    with Service("robot_link", options) as service:
        service.claim()
        shell = RobotShell(service, settings, channel)
        if not shell.load():
            return
        service.answer_later(HOME, shell.on_home)
        service.answer_later(MOVE, shell.on_move)
        service.answer(RESUME, shell.on_resume)
        shell.loop()


class RobotShell:
    """Answers motions once they are made."""

    def __init__(self, service: Service, settings: Settings, channel: Channel) -> None:
        self._service, self._settings = service, settings
        self._arm = Arm(settings.arm)
        terminal = Terminal(DIALECTS[settings.arm.dialect], echo=settings.arm.echo)
        line = Line(settings.url, settings.line)
        self._link = Link(line, channel, terminal, self._arm.get_ready, self._on_lost)
        self._clock = SensorClock()
        self._hold = Hold(settings.by_itself, time.time_ns())
        self._motion: Home | Move | None = None
        """Under way."""
        self._asked: list[Asked] = []
        """Who waits for it."""
        self._robot: Robot | None = None
        """None until it is known what runs."""
        service.subscribe(FT, FtPacket, self._on_ft, "sim", "sensor_jr3")

    def load(self) -> bool:
        """Learn from the task what runs; False when stopped meanwhile."""
        experiment = self._service.wait_for("task (no experiment)", self._service.ask_experiment)
        if experiment is not None:
            self._take_up(experiment)
        return experiment is not None

    def loop(self) -> None:
        """Work until stopped; the service is alive once the controller has been ready for the first time."""
        service, link, alive = self._service, self._link, False
        while not service.stopping:
            if link.ready and not alive:
                alive = True
                service.ready()
            self._show_phase()
            link.pump(_BUSY_S if link.busy or not link.ready else 0.0)
            service.work(0.0 if link.busy or not link.ready else _IDLE_S)
            for _ in range(_EVENTS):
                if not service.work(0.0):
                    break
        for asked in self._asked:
            asked.refuse(RefusedError("robot_link: expected to go on, but is stopping"))
        link.close()

    def on_home(self, asked: Asked, request: Request) -> None:
        """Begin ``home``; another run's is taken when the task says that this is what runs now."""
        home = request.message(Home)
        if self._is_under_way(asked, home):
            return
        self._hold.check(time.monotonic())
        if home.run != self._service.run:
            experiment = self._service.ask_experiment()
            if experiment is not None and experiment.run == home.run:
                self._take_up(experiment)
        self._moving.home(home)
        self._begin(asked, home, self._arm.home(home))

    def on_move(self, asked: Asked, request: Request) -> None:
        """Begin ``move``, or answer the last one again."""
        move = request.message(Move)
        if self._is_under_way(asked, move):
            return
        self._hold.check(time.monotonic())
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
            self._hold.insist(str(error), time.time_ns())
            raise
        self._begin(asked, move, self._arm.move(increment_of(move), move.episode, move.step))

    def on_resume(self, request: Request) -> Stop:
        """Let the arm move again, or say what holds it. Raises StoppedError, LinkError."""
        if not request.payload:
            return self._hold.stop
        resume, why = request.message(Resume), self._hold.stop.why
        if not self._link.ready:
            raise LinkError(f"resume: expected the controller to be ready, it is not: {self._link.trouble}")
        stop = self._hold.resume(resume)
        if why:
            self._service.log.warning("somebody lets the arm move again after: %s", why)
        return stop

    # -- details -----------------------------------------------------------------------------------------------------

    @property
    def _moving(self) -> Robot:
        """What answers motions. Raises LinkError before it is known what runs."""
        if self._robot is None:
            raise LinkError("robot: expected to know what runs, got no answer of the task yet")
        return self._robot

    def _is_under_way(self, asked: Asked, motion: Home | Move) -> bool:
        """Return whether this motion is being made; who asked waits for it then. Raises BusyError for another one."""
        if self._motion is None:
            return False
        if motion != self._motion:
            raise BusyError(f"robot: expected to be asked for one motion at a time, {_name(self._motion)} is under way")
        self._asked = [*[request for request in self._asked if request.open][-_EVENTS:], asked]
        return True

    def _begin(self, asked: Asked, motion: Home | Move, script: Script) -> None:
        self._link.run(script, self._on_end)
        self._motion, self._asked = motion, [asked]

    def _on_end(self, result: Increment | LinkError) -> None:
        motion, self._motion = self._motion, None
        waiting, self._asked = self._asked, []
        if isinstance(result, LinkError):
            self._hold.failed(str(result), time.time_ns(), time.monotonic())
        if isinstance(result, LinkError) or motion is None:
            for asked in waiting:
                asked.refuse(result if isinstance(result, LinkError) else LinkError("robot: nothing was under way"))
            return
        self._hold.succeeded()
        t_ns, robot = self._arrived_ns(), self._moving
        answer = robot.homed(motion, t_ns) if isinstance(motion, Home) else robot.moved(motion, result, t_ns)
        for asked in waiting:
            asked.reply(answer)

    def _arrived_ns(self) -> int:
        settle_ns = round(1e9 * self._settings.arm.settle_s)
        return self._clock.arrived(time.monotonic_ns(), time.time_ns(), settle_ns)

    def _on_lost(self, error: LinkError) -> None:
        if self._robot is not None:
            self._robot.lost()
        self._hold.trouble(str(error), time.time_ns())
        self._service.refuse(error)

    def _on_ft(self, packet: FtPacket) -> None:
        robot, now_ns = self._robot, time.monotonic_ns()
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
                robot.arrived(self._arrived_ns())
        if isinstance(self._motion, Move):  # home is the way out of a high force
            complaint = robot.pressing(packet)
            if complaint is not None:
                self._link.give_up(LinkError(complaint))

    def _show_phase(self) -> None:
        service = self._service
        if not self._link.ready:
            service.phase = f"waiting for the controller: {self._link.trouble}"[:200]
        elif self._motion is not None:
            service.phase = f"making {_name(self._motion)}"
        elif self._hold.held:
            service.phase = f"stopped: {self._hold.words()}"[:200]
        else:
            complaint = None if self._robot is None else self._robot.sensing(time.monotonic_ns())
            service.phase = "running" if complaint is None else f"stands: {complaint}"[:200]

    def _take_up(self, experiment: Experiment) -> None:
        self._robot = Robot(experiment.definition, experiment.run, self._settings.oldest_s)
        self._service.run = experiment.run


def _name(motion: Home | Move) -> str:
    return f"home of episode {motion.episode}" if isinstance(motion, Home) else f"step {motion.step}"
