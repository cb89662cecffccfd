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
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from experiments.export.source import Source
from experiments.export.steps import EpisodeRows, Row

FORMAT: Literal[9] = 9
"""Version of the bag's metadata: the one of Jazzy and later."""
TYPES = {
    "treenail_msgs/msg/Decision": """std_msgs/Header header
int64 decision
int32 episode
int32 motion
int32 state
int32 action
string action_name
int64 policy_version
""",
    "treenail_msgs/msg/Reward": """std_msgs/Header header
int64 decision
float64 reward
""",
    "treenail_msgs/msg/Episode": """std_msgs/Header header
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
TOPICS = {
    "wrench": "geometry_msgs/msg/WrenchStamped",
    "pose": "geometry_msgs/msg/PoseStamped",
    "decision": "treenail_msgs/msg/Decision",
    "reward": "treenail_msgs/msg/Reward",
    "episode": "treenail_msgs/msg/Episode",
}
TOOL, HOLE = "tool", "hole"


def write(path: Path, source: Source, episodes: Iterable[EpisodeRows]) -> int:
    """Write the bag's folder and return its messages."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in TYPES.items():
        store.register(get_types_from_msg(text, name))
    count = 0
    with Writer(path, version=FORMAT, storage_plugin=StoragePlugin.MCAP) as bag:
        connections = {
            topic: bag.add_connection(f"/treenail/{topic}", kind, typestore=store) for topic, kind in TOPICS.items()
        }

        def put(topic: str, t_ns: int, frame: str, **fields: Any) -> None:
            nonlocal count
            kind = TOPICS[topic]
            stamp = store.types["builtin_interfaces/msg/Time"](sec=t_ns // 10**9, nanosec=t_ns % 10**9)
            header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)
            message = store.types[kind](header=header, **fields)
            bag.write(connections[topic], t_ns, store.serialize_cdr(message, kind))
            count += 1

        for episode in episodes:
            for row in episode.rows:
                _put_row(put, store, row)
            summary = episode.summary
            put(
                "episode",
                episode.end_ns,
                TOOL,
                episode=summary.episode,
                outcome=summary.outcome,
                episode_return=summary.episode_return,
                moves=summary.moves,
                decisions=summary.decisions,
                mean_force_n=summary.mean_force_n,
                peak_force_n=summary.peak_force_n,
                mean_torque_nm=summary.mean_torque_nm,
                peak_torque_nm=summary.peak_torque_nm,
                states=summary.states,
            )
    return count


def _put_row(put: Callable[..., None], store: Any, row: Row) -> None:
    vector = store.types["geometry_msgs/msg/Vector3"]
    x, y, z, qw, qx, qy, qz = row.flange
    pose = store.types["geometry_msgs/msg/Pose"](
        position=store.types["geometry_msgs/msg/Point"](x=x * 1e-3, y=y * 1e-3, z=z * 1e-3),
        orientation=store.types["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
    )
    put("pose", row.t_ns, HOLE, pose=pose)
    if row.decision is None or row.force_n is None or row.torque_nm is None:
        return
    wrench = store.types["geometry_msgs/msg/Wrench"](
        force=vector(*row.force_n),
        torque=vector(*row.torque_nm),
    )
    put("wrench", row.t_ns, TOOL, wrench=wrench)
    put(
        "decision",
        row.t_ns,
        TOOL,
        decision=row.decision,
        episode=row.episode,
        motion=row.motion,
        state=-1 if row.state is None else row.state,
        action=-1 if row.action is None else row.action,
        action_name=row.action_name,
        policy_version=-1 if row.policy_version is None else row.policy_version,
    )
    if row.reward is not None:
        put("reward", row.t_ns, TOOL, decision=row.decision, reward=row.reward)
