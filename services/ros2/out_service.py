"""What a cell feels and does, as topics of ROS 2: `ros2 topic list`, `echo`, PlotJuggler and Foxglove see them.

    <prefix>/wrench    geometry_msgs/WrenchStamped   each F/T sample [N, N m], frame ``tool``
    <prefix>/tip       geometry_msgs/PoseStamped     where each decision commands the tip to [m], frame ``hole``
    <prefix>/episode   std_msgs/Int32                the one under way
    <prefix>/step      std_msgs/Int32                motions made in it before each decision
    <prefix>/outcome   std_msgs/String               how an episode ended
    <prefix>/summary   treenail_msgs/Episode         the same in full, of a type of our own

It looks on: nobody waits for it or notices when it is gone. Stamps are the sensor's own time, simulated
where it is.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from services.bus.onlooker import Inlet, Question
from services.bus.service import Options, Service
from services.ros2 import messages, names
from services.ros2.graph import node_with
from services.ros2.messages import Wrench
from services.ros2.node import Node
from services.ros2.settings import Graph
from services.ros2.tip import Tip
from services.rules.poses import quaternion
from services.wire.keys import ACTION, EPISODE, EXPERIMENT, FT
from services.wire.messages import Action, EpisodeSummary, Experiment, FtPacket

TOOL, HOLE = "tool", "hole"
_DRAIN_S, _ASK_S = 0.005, 2.0


@dataclass(frozen=True)
class Settings:
    """What the service is started with."""

    graph: Graph = field(default_factory=Graph)
    prefix: str | None = None
    """Of all topics; None for ``/treenail/<cell>``."""


class OutShell:
    """Publishes what comes in."""

    def __init__(self, service: Service, node: Node, prefix: str) -> None:
        self._service, self._messages = service, node.messages
        self._wrench = node.publisher(f"{prefix}/wrench", messages.WRENCH)
        self._tip_pose = node.publisher(f"{prefix}/tip", messages.POSE)
        self._episode = node.publisher(f"{prefix}/episode", messages.INT32)
        self._step = node.publisher(f"{prefix}/step", messages.INT32)
        self._outcome = node.publisher(f"{prefix}/outcome", messages.STRING)
        self._summary = node.publisher(f"{prefix}/summary", messages.EPISODE)
        self._drains = (
            Inlet(service, FT, FtPacket, self.felt).drain,
            Inlet(service, ACTION, Action, self.decided).drain,
            Inlet(service, EPISODE, EpisodeSummary, self.ended).drain,
        )
        self._experiment = Question(service, EXPERIMENT, Experiment)
        self._tip: Tip | None = None
        self._under_way: int | None = None
        self._t_ns = 0

    def loop(self) -> None:
        """Work until stopped."""
        asked_s = 0.0
        while not self._service.stopping:
            self._service.work_until(lambda: False, _DRAIN_S)
            for drain in self._drains:
                drain()
            self._look(self._experiment.answer())
            now = time.monotonic()
            if now - asked_s >= _ASK_S:
                asked_s = now
                self._experiment.ask()

    def felt(self, packet: FtPacket) -> None:
        """Publish the samples of a packet."""
        self._t_ns = packet.t_ns
        count = len(packet.force_n)
        for place, (force_n, torque_nm) in enumerate(zip(packet.force_n, packet.torque_nm, strict=False)):
            t_ns = max(0, packet.t_ns - (count - 1 - place) * packet.period_ns)
            self._wrench(self._messages.wrench(Wrench(t_ns, TOOL, force_n, torque_nm)))

    def decided(self, action: Action) -> None:
        """Publish where a decision stands and leads to."""
        if action.episode != self._under_way:
            self._under_way = action.episode
            self._episode(self._messages.made(messages.INT32, data=action.episode))
        self._step(self._messages.made(messages.INT32, data=action.step))
        tip = None if self._tip is None or self._tip.run != action.run else self._tip.decided(action)
        if tip is not None:
            x, y, z = (value * 1e-3 for value in tip.position_mm)
            pose = messages.Pose(self._t_ns, HOLE, (x, y, z), quaternion(tip.turn))
            self._tip_pose(self._messages.pose(pose))

    def ended(self, summary: EpisodeSummary) -> None:
        """Publish what came of an episode."""
        self._outcome(self._messages.made(messages.STRING, data=summary.outcome))
        self._summary(self._messages.episode(summary, self._t_ns, TOOL))

    def _look(self, experiment: Experiment | None) -> None:
        if experiment is not None and (self._tip is None or experiment.run != self._tip.run):
            self._service.run = experiment.run
            self._tip, self._under_way = Tip(experiment), None


def serve(options: Options, settings: Settings) -> None:
    """Publish until stopped."""
    with Service("ros2_out", options) as service:
        service.claim()
        with node_with(service, settings.graph) as node:
            if node is None:
                return
            prefix = settings.prefix or f"/treenail/{names.word(service.keys.cell)}"
            shell = OutShell(service, node, prefix)
            service.ready()
            service.log.info("ROS 2: %s/wrench and more in domain %d", prefix, settings.graph.domain)
            shell.loop()
