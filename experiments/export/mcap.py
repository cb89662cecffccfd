"""A run as a rosbag2 in an MCAP file, with all its message definitions: no ROS needed to write, read or look at it.

Topics: ``/treenail/wrench`` (geometry_msgs/WrenchStamped, frame ``tool``) what was felt at each decision,
``/treenail/pose`` (geometry_msgs/PoseStamped, frame ``hole``, in metres) where the tip was commanded to before each
motion, ``/treenail/decision``, ``/treenail/reward`` and ``/treenail/episode`` of types that the file itself defines.
Times are on the clock of steps, 20 ms a motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Literal

from rosbags.rosbag2 import StoragePlugin, Writer

from experiments.export.source import Source
from experiments.export.steps import EpisodeRows, Row
from services.ros2 import messages
from services.ros2.messages import Messages, Pose, Wrench

FORMAT: Literal[9] = 9
"""Version of the bag's metadata: the one of Jazzy and later."""
TOPICS = {
    "wrench": messages.WRENCH,
    "pose": messages.POSE,
    "decision": messages.DECISION,
    "reward": messages.REWARD,
    "episode": messages.EPISODE,
}
TOOL, HOLE = "tool", "hole"


def write(path: Path, source: Source, episodes: Iterable[EpisodeRows]) -> int:
    """Write the bag's folder and return its messages."""
    types = Messages()
    count = 0
    with Writer(path, version=FORMAT, storage_plugin=StoragePlugin.MCAP) as bag:
        connections = {
            topic: bag.add_connection(f"/treenail/{topic}", kind, typestore=types.store)
            for topic, kind in TOPICS.items()
        }

        def write(topic: str, t_ns: int, data: bytes) -> None:
            nonlocal count
            bag.write(connections[topic], t_ns, data)
            count += 1

        def put(topic: str, t_ns: int, **fields: Any) -> None:
            write(topic, t_ns, types.made(TOPICS[topic], header=types.header(t_ns, TOOL), **fields))

        for episode in episodes:
            for row in episode.rows:
                write("pose", row.t_ns, types.pose(_commanded(row)))
                if row.force_n is not None and row.torque_nm is not None:
                    write("wrench", row.t_ns, types.wrench(Wrench(row.t_ns, TOOL, row.force_n, row.torque_nm)))
                _put_decision(put, row)
            write("episode", episode.end_ns, types.episode(episode.summary, episode.end_ns, TOOL))
    return count


def _commanded(row: Row) -> Pose:
    x, y, z, *orientation = row.flange
    w, i, j, k = orientation
    return Pose(row.t_ns, HOLE, (x * 1e-3, y * 1e-3, z * 1e-3), (w, i, j, k))


def _put_decision(put: Callable[..., None], row: Row) -> None:
    if row.decision is None or row.force_n is None:
        return
    put(
        "decision",
        row.t_ns,
        decision=row.decision,
        episode=row.episode,
        motion=row.motion,
        state=-1 if row.state is None else row.state,
        action=-1 if row.action is None else row.action,
        action_name=row.action_name,
        policy_version=-1 if row.policy_version is None else row.policy_version,
    )
    if row.reward is not None:
        put("reward", row.t_ns, decision=row.decision, reward=row.reward)
