"""The simulator on the bus: what robot_link and a sensor would be, with the same messages."""

from __future__ import annotations

import time

from services.bus.answers import Request
from services.bus.service import Options, Service
from services.sim.cell import SimulatedCell, truth_of
from services.sim.progress import follow
from services.wire.keys import FT, HOME, MOVE, RESUME, TRUTH
from services.wire.messages import Experiment, FtPacket, Home, Move, Moved, Stop, Truth

TRUTH_EVERY_S = 1 / 30


def serve(options: Options, progress: bool) -> None:
    """Run the simulator until it is stopped; with ``progress``, print how the run goes."""
    with Service("sim", options) as service:
        service.claim()
        work(service, progress)


def work(service: Service, progress: bool = False) -> None:
    """Be the simulator of a cell until stopped."""
    shell = SimShell(service)
    experiment = shell.load()
    if experiment is None:
        return
    if progress:
        follow(service, experiment)
    service.answer(HOME, shell.on_home)
    service.answer(MOVE, shell.on_move)
    service.answer(RESUME, lambda _: Stop(stop_t_ns=0, why=""))  # nobody is hurt: nothing ever holds it
    service.ready()
    service.loop()


class SimShell:
    """Answers motions with what was applied, after publishing what was felt."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._publish_ft = service.publisher(FT, FtPacket, with_next=True)  # the answer to the motion
        self._publish_truth = service.publisher(TRUTH, Truth, drop=True)
        self._next_truth = 0.0
        self._cell: SimulatedCell

    def load(self) -> Experiment | None:
        """Learn from the task what to simulate, and build it; None when stopped meanwhile."""
        experiment = self._service.wait_for("task (no experiment)", self._service.ask_experiment)
        if experiment is not None:
            self._build(experiment)
        return experiment

    def on_home(self, request: Request) -> Moved:
        """Answer ``home``; another run's is taken when the task says that this is what runs now."""
        home = request.message(Home)
        if home.run != self._service.run:
            experiment = self._service.ask_experiment()
            if experiment is not None and experiment.run == home.run:
                self._build(experiment)
        return self._publish(*self._cell.home(home))

    def on_move(self, request: Request) -> Moved:
        """Answer ``move``."""
        return self._publish(*self._cell.move(request.message(Move)))

    def _build(self, experiment: Experiment) -> None:
        self._cell = SimulatedCell(experiment.definition, experiment.run, experiment.seed)
        self._service.run = experiment.run

    def _publish(self, moved: Moved, packet: FtPacket) -> Moved:
        self._publish_ft(packet)
        now = time.monotonic()
        if now >= self._next_truth:
            self._next_truth = now + TRUTH_EVERY_S
            self._service.post(self._tell, moved)  # when the motion is answered: who watches can wait
        return moved

    def _tell(self, moved: Moved) -> None:
        """Publish where the peg is after a motion."""
        self._publish_truth(truth_of(self._cell.world, moved))
