"""Messages of ROS 2 as bytes, and back: CDR and the hashes of types, by rosbags. Pure.

Also for what is exported: nothing else in Treenail makes a message of ROS 2.
"""

from __future__ import annotations

import math
import struct
from typing import Any, NamedTuple

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from services.ros2.distributions import DISTRIBUTIONS, USUAL, Distribution
from services.ros2.errors import MessageError
from services.rules.quaternion import Quaternion
from services.wire.messages import EpisodeSummary, Force, Torque

WRENCH, POSE = "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/PoseStamped"
INT32, FLOAT64, STRING = "std_msgs/msg/Int32", "std_msgs/msg/Float64", "std_msgs/msg/String"
DECISION, REWARD, EPISODE = "treenail_msgs/msg/Decision", "treenail_msgs/msg/Reward", "treenail_msgs/msg/Episode"
OWN = {
    DECISION: """std_msgs/Header header
int64 decision
int32 episode
int32 motion
int32 state
int32 action
string action_name
int64 policy_version
""",
    REWARD: """std_msgs/Header header
int64 decision
float64 reward
""",
    EPISODE: """std_msgs/Header header
int32 episode
string outcome
float64 episode_return
int32 moves
int32 decisions
float64 mean_force_n
float64 peak_force_n
float64 mean_torque_nm
float64 peak_torque_nm
int32 states
""",
}
"""Types of our own, as a package ``treenail_msgs`` would have them."""
_OF_EPISODE = (
    "episode",
    "outcome",
    "episode_return",
    "moves",
    "decisions",
    "mean_force_n",
    "peak_force_n",
    "mean_torque_nm",
    "peak_torque_nm",
    "states",
)
NS = 1_000_000_000
MOST_BYTES = 4096
"""Of a wrench or a pose, whose only text is the name of a frame."""
_UNIT = 1e-3
"""How far the length of an orientation's quaternion may be from 1."""
# What rosbags raises for bytes that are no such message.
_UNREADABLE = (AssertionError, IndexError, KeyError, OverflowError, TypeError, ValueError, SerdeError, struct.error)


class Wrench(NamedTuple):
    """A WrenchStamped."""

    t_ns: int
    """Stamp of its header."""
    frame: str
    force_n: Force
    torque_nm: Torque


class Pose(NamedTuple):
    """A PoseStamped."""

    t_ns: int
    """Stamp of its header."""
    frame: str
    position_m: tuple[float, float, float]
    orientation: Quaternion
    """w, x, y, z."""


class Messages:
    """The messages of one distribution."""

    def __init__(self, distribution: Distribution = DISTRIBUTIONS[USUAL]) -> None:
        self.distribution = distribution
        self.store: Any = get_typestore(Stores(distribution.definitions))
        """Of rosbags."""
        for name, text in OWN.items():
            self.store.register(get_types_from_msg(text, name))

    def type_hash(self, kind: str) -> str:
        """Return the hash of a type, as it stands in keys: RIHS01 and 64 digits."""
        return str(self.store.hash_rihs01(kind))

    def definition(self, kind: str) -> str:
        """Return the definition of a type with all that it needs, as text."""
        text, *_ = self.store.generate_msgdef(kind, ros_version=2)
        return str(text)

    def made(self, kind: str, **fields: Any) -> bytes:
        """Return a message of any type as bytes, from its fields by name."""
        return bytes(self.store.serialize_cdr(self.store.types[kind](**fields), kind))

    def header(self, t_ns: int, frame: str) -> Any:
        """Return a header: a time from 0 to the year 2038, in nanoseconds, and the name of a frame."""
        types = self.store.types
        stamp = types["builtin_interfaces/msg/Time"](sec=t_ns // NS % 2**31, nanosec=t_ns % NS)
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)

    def episode(self, summary: EpisodeSummary, t_ns: int, frame: str) -> bytes:
        """Return what came of an episode, of our own type."""
        told = {name: getattr(summary, name) for name in _OF_EPISODE}
        return self.made(EPISODE, header=self.header(t_ns, frame), **told)

    def wrench(self, wrench: Wrench) -> bytes:
        """Return a WrenchStamped."""
        types = self.store.types
        vector = types["geometry_msgs/msg/Vector3"]
        load = types["geometry_msgs/msg/Wrench"](force=vector(*wrench.force_n), torque=vector(*wrench.torque_nm))
        return self.made(WRENCH, header=self.header(wrench.t_ns, wrench.frame), wrench=load)

    def pose(self, pose: Pose) -> bytes:
        """Return a PoseStamped."""
        types = self.store.types
        w, x, y, z = pose.orientation
        place = types["geometry_msgs/msg/Pose"](
            position=types["geometry_msgs/msg/Point"](*pose.position_m),
            orientation=types["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w),
        )
        return self.made(POSE, header=self.header(pose.t_ns, pose.frame), pose=place)

    def read_wrench(self, data: bytes) -> Wrench:
        """Return what a WrenchStamped says. Raises MessageError for bytes that are none, and numbers that are none."""
        message = self._read(data, WRENCH)
        force, torque = message.wrench.force, message.wrench.torque
        t_ns, frame = _stamped(message)
        read = Wrench(t_ns, frame, (force.x, force.y, force.z), (torque.x, torque.y, torque.z))
        if not all(map(math.isfinite, (*read.force_n, *read.torque_nm))):
            raise MessageError(f"{WRENCH}: expected finite numbers, got {read.force_n} N and {read.torque_nm} N m")
        return read

    def read_pose(self, data: bytes) -> Pose:
        """Return what a PoseStamped says. Raises MessageError for bytes that are none, and for what is no place."""
        message = self._read(data, POSE)
        at, turn = message.pose.position, message.pose.orientation
        t_ns, frame = _stamped(message)
        read = Pose(t_ns, frame, (at.x, at.y, at.z), (turn.w, turn.x, turn.y, turn.z))
        length = math.hypot(*read.orientation)
        if not all(map(math.isfinite, read.position_m)) or not abs(length - 1.0) <= _UNIT:
            raise MessageError(
                f"{POSE}: expected finite numbers and a quaternion of length 1, got {read.position_m} m and "
                f"{read.orientation}"
            )
        return read

    def read_number(self, data: bytes) -> int:
        """Return the whole number that a String says. Raises MessageError for another one."""
        said = self.read_text(data)
        if not (said.isascii() and said.isdigit() and len(said) < 19):
            raise MessageError(f"{STRING}: expected a whole number, got {said[:40]!r}")
        return int(said)

    def read_text(self, data: bytes) -> str:
        """Return what a String says. Raises MessageError."""
        return str(self._read(data, STRING).data)

    def _read(self, data: bytes, kind: str) -> Any:
        if len(data) > MOST_BYTES:
            raise MessageError(f"{kind}: expected at most {MOST_BYTES} bytes, got {len(data)}")
        try:
            return self.store.deserialize_cdr(data, kind)
        except _UNREADABLE:
            raise MessageError(f"{kind}: expected its bytes as CDR, got {len(data)} others") from None


def _stamped(message: Any) -> tuple[int, str]:
    stamp = message.header.stamp
    return stamp.sec * NS + stamp.nanosec, str(message.header.frame_id)
