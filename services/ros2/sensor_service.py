"""A WrenchStamped topic of ROS 2 as a cell's sensor: samples as packets, troubles as status; nothing moves then."""

from __future__ import annotations

import time
from collections import deque

from services.bus.opening import Opening
from services.bus.service import Options, Service
from services.ros2.errors import ClockError, FrameError, MessageError, PeerError, Ros2Error, SampleError, SilentError
from services.ros2.graph import node_with
from services.ros2.messages import WRENCH
from services.ros2.names import Endpoint, Qos
from services.ros2.node import Node, Sample, nobody, publishers
from services.ros2.sensor_settings import Settings
from services.ros2.stream import CHANGED, LOST, NOT_ZEROED, Stream
from services.wire.keys import FT
from services.wire.messages import FtPacket

_KEPT, _TURN = 1 << 14, 256
_WORK_S, _LOOK_S = 0.001, 1.0


def serve(options: Options, settings: Settings) -> None:
    """Run the sensor until it is stopped."""
    with Service("ros2_sensor", options) as service:
        service.claim()
        with node_with(service, settings.graph, "_sensor") as node:
            if node is not None:
                SensorShell(service, settings, node).run()


class SensorShell:
    """Makes packets of what comes."""

    def __init__(self, service: Service, settings: Settings, node: Node) -> None:
        self._service, self._settings, self._node = service, settings, node
        self._publish = service.publisher(FT, FtPacket)
        self._stream = Stream(settings.frame, settings.rate_hz, settings.mount, settings.oldest_s)
        self._came: deque[Sample] = deque(maxlen=_KEPT)
        self._ahead_ns = time.time_ns() - time.monotonic_ns()
        self._good_s = time.monotonic()
        self._good = self._ready = False
        """Whether the last thing said was a sample; whether there was one."""
        self._trouble = ""
        """Why what came last could not be used."""
        self._looking: Opening[list[Endpoint]] | None = None
        self._looked_s = 0.0
        self._lost = 0

    def run(self) -> None:
        """Publish until stopped."""
        service = self._service
        self._publish(self._stream.say(NOT_ZEROED, time.time_ns()))
        self._node.subscribe(self._settings.topic, WRENCH, self._came.append, Qos(reliable=False))
        while not service.stopping:
            for _ in range(_TURN):
                if not self._came:
                    break
                self.take(self._came.popleft())
            self.watch(time.monotonic())
            service.work(_WORK_S)

    def take(self, sample: Sample) -> None:
        """Take one sample of the topic: publish it, or say why not."""
        service, came_ns = self._service, sample.came_ns + self._ahead_ns
        try:
            attached = self._node.read(sample, WRENCH)
            if self._stream.comes_from_another(attached):
                self._say(CHANGED)
            packet = self._stream.take(self._node.messages.read_wrench(sample.data), attached, came_ns)
        except (ClockError, FrameError, MessageError) as error:
            # It is the sensor itself that cannot be believed: the robot has to know at once.
            self._refuse(error)
            self._say(CHANGED if isinstance(error, ClockError) else LOST)
            return
        except (PeerError, SampleError) as error:
            self._refuse(error)
            return
        self._publish(packet)
        self._good_s, self._good, self._trouble = time.monotonic(), True, ""
        service.handled += 1
        if self._stream.lost > self._lost:
            service.refused["LostSamples"] += self._stream.lost - self._lost
            service.complain(f"sensor: {self._stream.lost} samples lost since the start", topic="lost")
            self._lost = self._stream.lost
        if not self._ready:
            self._ready = True
            service.ready()
        service.phase = "running" if not self._lost else f"running, {self._lost} samples lost"

    def watch(self, now: float) -> None:
        """Say that nothing comes, and look who is there instead."""
        silent_s = now - self._good_s
        if silent_s <= self._settings.silent_s:
            return
        if self._good:
            self._say(LOST)
            self._stream.begin()
        if now - self._looked_s >= _LOOK_S and self._looking is None:
            self._looked_s, self._looking = now, Opening(self._node.there, lambda _: None)
        if self._looking is not None and self._looking.done:
            there, self._looking = self._looking.result(), None
            self._service.phase = f"no sensor: {self._why(there)}"[:200]
            self._service.refuse(SilentError(f"sensor: {self._why(there)}"))
            self._say(LOST)

    # -- details -----------------------------------------------------------------------------------------------------

    def _why(self, there: list[Endpoint]) -> str:
        topic = self._settings.topic
        here = publishers(there, topic)
        if self._trouble:
            return self._trouble
        if not here:
            return nobody(there, topic, WRENCH, self._node.domain)
        return f"expected samples on {topic}, which {here[0].node} publishes, got none"

    def _refuse(self, error: Ros2Error) -> None:
        self._trouble = str(error)
        self._service.refuse(error)

    def _say(self, status: int) -> None:
        self._good = False
        self._publish(self._stream.say(status, time.time_ns()))
