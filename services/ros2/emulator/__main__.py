"""``python -m services.ros2.emulator``: an emulated Cartesian controller of ROS 2, until it is stopped.

It is at a target at once, and reports it. Its own are only the numbers of motions, which it hears beside the targets
and says when one is made: a simulator that draws noise draws it by episode and step.
"""

from __future__ import annotations

import logging
import time
from collections import deque

from services.bus import command
from services.bus.emulated_arm import Arm, ArmFault, IdealArm, WorldArm
from services.bus.session import open_client
from services.bus.stop_flag import StopFlag
from services.bus.world import World
from services.ros2 import messages
from services.ros2.errors import MessageError, Ros2Error
from services.ros2.messages import Messages, Wrench
from services.ros2.node import Node, Sample
from services.rules.command_line import Parser, number, whole
from services.rules.poses import from_quaternion, from_rotation_vector, quaternion, rotation_vector
from services.wire.keys import Keys
from services.wire.text import numbers

LOG = logging.getLogger("ros2-emulator")
CONTROLLER, FRAME, TOOL = "/compliance", "base_link", "tool"
TARGET, POSE, WRENCH = f"{CONTROLLER}/target_frame", f"{CONTROLLER}/current_pose", "/fts/wrench"
START = "0.1203,-0.4317,0.2146,0.7627,-0.6405,0.0561,0.0714"
WORLD_S = 20.0
_KEPT = 1 << 12


class Emulator:
    """The controller: one target after the other, then what the wrist feels and where the arm is."""

    def __init__(self, node: Node, arm: Arm, rate_hz: float) -> None:
        self._node, self._arm, self._messages = node, arm, node.messages
        self._period_s, self._next_s = 1.0 / rate_hz, 0.0
        self._came: deque[tuple[str, Sample]] = deque(maxlen=_KEPT)
        self._motion: tuple[int, int, int] | None = None
        self._felt = 0
        node.subscribe(f"{TARGET}/motion", messages.STRING, lambda sample: self._came.append((messages.STRING, sample)))
        node.subscribe(TARGET, messages.POSE, lambda sample: self._came.append((messages.POSE, sample)))
        self._made = node.publisher(f"{POSE}/made", messages.STRING)
        self._pose, self._wrench = node.publisher(POSE, messages.POSE), node.publisher(WRENCH, messages.WRENCH)

    def step(self) -> None:
        """Do what is due."""
        while self._came:
            kind, sample = self._came.popleft()
            try:
                self._node.read(sample, kind)
                if kind == messages.STRING:
                    self._motion = _motion(self._messages.read_text(sample.data))
                else:
                    self._go(self._messages.read_pose(sample.data))
            except (Ros2Error, ArmFault) as error:
                LOG.warning("%s", error)
        now = time.monotonic()
        if now < self._next_s:
            time.sleep(min(0.001, self._next_s - now))
            return
        self._next_s = max(self._next_s + self._period_s, now)
        self._report()

    def _go(self, target: messages.Pose) -> None:
        if target.frame != FRAME:
            raise MessageError(f"target: expected frame {FRAME}, got {target.frame[:40]!r}")
        goal = (*target.position_m, *rotation_vector(from_quaternion(target.orientation)))
        if self._motion is None:
            self._arm.stop_at(goal)
            return
        number, episode, step = self._motion
        told = (None, None) if episode < 0 else (episode, step)
        self._arm.move_to(goal, *told)
        self._report()
        self._made(self._messages.made(messages.STRING, data=str(number)))

    def _report(self) -> None:
        loads = self._arm.loads
        load = loads[self._felt % len(loads)]
        self._felt += 1
        force_n, torque_nm = (load[0], load[1], load[2]), (load[3], load[4], load[5])
        self._wrench(self._messages.wrench(Wrench(time.time_ns(), TOOL, force_n, torque_nm)))
        x, y, z, *vector = self._arm.pose
        turn = quaternion(from_rotation_vector((vector[0], vector[1], vector[2])))
        self._pose(self._messages.pose(messages.Pose(time.time_ns(), FRAME, (x, y, z), turn)))


def _motion(said: str) -> tuple[int, int, int] | None:
    if not said:
        return None
    try:
        number, episode, step = (int(word) for word in said.split(" "))
    except ValueError:
        raise MessageError(f"motion: expected number, episode and step, got {said[:40]!r}") from None
    return number, episode, step


def start_of(said: str) -> tuple[float, ...]:
    """Return X, Y, Z [m] and rotation vector [rad] of a pose as ROS shows it."""
    x, y, z, qx, qy, qz, qw = numbers(said, 7)
    return (x, y, z, *rotation_vector(from_quaternion((qw, qx, qy, qz))))


def main() -> None:
    """Parse the command line and serve."""
    parser = Parser(prog="python -m services.ros2.emulator", description=__doc__)
    parser.add_argument("--start", default=START, metavar="X,Y,Z,QX,QY,QZ,QW", help="the taught start pose [m]")
    parser.add_argument("--start-height-mm", type=number(0.0, 500.0), default=20.0, help="its tip above the mouth")
    parser.add_argument("--world", metavar="CELL", help="the peg is that of the simulator in this cell")
    parser.add_argument("--rate-hz", type=number(1.0, 1000.0), default=125.0, help="of poses and wrenches")
    parser.add_argument("--domain", type=whole(0, 232), default=0, help="ROS_DOMAIN_ID (default: 0)")
    command.add_arguments(parser)
    arguments = parser.parse_args()
    stop, options, start = StopFlag(), command.options(arguments), start_of(arguments.start)
    session = open_client(options.connect, options.connect_timeout_s, stop.is_set, options.certs)
    arm: Arm = IdealArm(start)
    if arguments.world is not None:
        world = World(session, Keys(options.cell), Keys(arguments.world), 0.0, WORLD_S)
        arm = WorldArm(world, start, arguments.start_height_mm)
    emulator = Emulator(Node(session, arguments.domain, "compliance", Messages()), arm, arguments.rate_hz)
    LOG.info("a controller on %s", TARGET)
    while not stop:
        emulator.step()
    session.close()  # type: ignore[no-untyped-call]


if __name__ == "__main__":
    command.run("ros2-emulator", main)
