"""An arm behind a Cartesian controller of ROS 2, on the bus: motions as of every arm (``services.bus.robot``)."""

from __future__ import annotations

import time
from collections import deque

from services.bus.robot import Manner, RobotShell
from services.bus.service import Options, Service
from services.ros2 import messages
from services.ros2.errors import FrameError, Ros2Error, SampleError
from services.ros2.graph import node_with
from services.ros2.motion import Arm, Script
from services.ros2.names import Endpoint, Qos
from services.ros2.node import Node, Sample
from services.ros2.robot_link import Link, Told
from services.ros2.robot_settings import Settings
from services.rules.poses import Pose, from_quaternion, quaternion

MOTION, MADE = "motion", "made"
"""What is added to the topics of targets and poses for the numbers that an emulated controller asks for."""
_KEPT = 1 << 12


def serve(options: Options, settings: Settings) -> None:
    """Run the service until it is stopped."""
    with Service("ros2_robot", options) as service:
        service.claim()
        with node_with(service, settings.graph, "_robot") as node:
            if node is None:
                return
            topics = Topics(service, node, settings)
            arm = Arm(settings)
            shell: RosShell
            link = Link(topics, arm, settings, lambda error: shell.lost(error))
            shell = RosShell(service, link, arm, topics, settings)
            if shell.load():
                shell.serve()


class Topics:
    """The controller's topics."""

    def __init__(self, service: Service, node: Node, settings: Settings) -> None:
        self._service, self._node, self._settings = service, node, settings
        self._messages = node.messages
        self._target = node.publisher(settings.target, messages.POSE)
        self._motion = node.publisher(f"{settings.target}/{MOTION}", messages.STRING) if settings.tell else None
        self._poses: deque[Sample] = deque(maxlen=_KEPT)
        self._made: deque[Sample] = deque(maxlen=_KEPT)
        node.subscribe(settings.pose, messages.POSE, self._poses.append, Qos(reliable=False))
        if settings.tell:
            node.subscribe(f"{settings.pose}/{MADE}", messages.STRING, self._made.append)
        self._newest = (b"", 0)
        """Who reports, and the number of the newest sample."""
        self._newest_s = 0.0

    def send(self, target: Pose, told: Told | None) -> None:
        """See robot_link.Controller."""
        if self._motion is not None:
            said = "" if told is None else f"{told.number} {told.episode} {told.step}"
            self._motion(self._messages.made(messages.STRING, data=said))
        x, y, z = (value / 1000.0 for value in target.position_mm)
        pose = messages.Pose(time.time_ns(), self._settings.frame, (x, y, z), quaternion(target.turn))
        self._target(self._messages.pose(pose))

    def there(self) -> list[Endpoint]:
        """See robot_link.Controller."""
        return [one for one in self._node.there() if one.node != self._node.name]

    def drain(self, link: Link) -> None:
        """Give the link what has come; refuse and count what cannot be used."""
        while self._made:
            sample = self._made.popleft()
            try:
                self._node.read(sample, messages.STRING)
                link.made(self._messages.read_number(sample.data))
            except Ros2Error as error:
                self._service.refuse(error)
        while self._poses:
            sample = self._poses.popleft()
            try:
                link.heard(self._read(sample), sample.came_ns * 1e-9)
                self._service.handled += 1
            except Ros2Error as error:
                self._service.refuse(error)

    def _read(self, sample: Sample) -> Pose:
        attached = self._node.read(sample, messages.POSE)
        pose = self._messages.read_pose(sample.data)
        if pose.frame != self._settings.frame:
            raise FrameError(f"frame: expected {self._settings.frame!r} (--frame), got {pose.frame[:40]!r}")
        gid, number = self._newest
        came_s = sample.came_ns * 1e-9
        if came_s - self._newest_s <= self._settings.silent_s:  # after a silence it may be another one
            if attached.gid != gid:
                raise SampleError("publisher: expected one of poses, got a sample of another one; end one of them")
            if attached.sequence <= number:
                raise SampleError(f"pose: expected number {number + 1} or later, got {attached.sequence}: unordered")
        self._newest, self._newest_s = (attached.gid, attached.sequence), came_s
        x, y, z = (1000.0 * value for value in pose.position_m)
        return Pose((x, y, z), from_quaternion(pose.orientation))


class RosShell(RobotShell[Script]):
    """The shell of every arm; what is felt comes from a sensor of its own."""

    def __init__(self, service: Service, link: Link, arm: Arm, topics: Topics, settings: Settings) -> None:
        super().__init__(service, link, arm, Manner(settings.settle_s, settings.oldest_s, settings.by_itself))
        self._ros, self._topics = link, topics

    def pump(self) -> None:
        """See RobotShell."""
        self._topics.drain(self._ros)
        super().pump()
