"""Independent peers of ROS 2 over Zenoh, by the router of a cell: what we publish they read, and we what they do.

``zenoh-ros2-sdk`` and ``pyzeros`` are other people's, and know nothing of Treenail. Each runs in a process of its own.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import zenoh

from services.bus import ports
from services.bus.session import open_client
from services.wire.codec import decode, encode, encoding_of
from services.wire.keys import FT, Keys
from services.wire.messages import FtPacket

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")
pytest.importorskip("xxhash", reason="the extra ros2 is not installed")

from services.ros2.attachment import Attachment, written
from services.ros2.messages import WRENCH, Messages, Wrench
from services.ros2.names import endpoint, tokens_key, topic_key
from services.ros2.stream import LOST, NOT_ZEROED

KEYS = Keys("a")
TOPIC = "/treenail/a/wrench"
FRAMES = 5

SDK_HEARS = """
import json, sys, time
from zenoh_ros2_sdk import ROS2Subscriber
port, topic, kind, definition, type_hash, count = json.loads(sys.argv[1])
heard = []
def take(message):
    w = message.wrench
    heard.append([message.header.frame_id, message.header.stamp.sec, message.header.stamp.nanosec,
                  w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z])
ROS2Subscriber(topic, kind, take, msg_definition=definition, type_hash=type_hash, router_port=port)
print("listening", flush=True)
while len(heard) < count:
    time.sleep(0.01)
print(json.dumps(heard[:count]), flush=True)
"""
PYZEROS_HEARS = """
import json, sys, time
import pyzeros, zenoh
from pyzeros.sub import RawSub
from ros2_pyterfaces.cydr.all_msgs import WrenchStamped
port, topic, kind, definition, type_hash, count = json.loads(sys.argv[1])
assert WrenchStamped.hash_rihs01() == type_hash
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [f"tcp/127.0.0.1:{port}"]}}))
def text(value):
    return value.decode() if isinstance(value, bytes) else str(value)
heard = []
def take(sample):
    message = WrenchStamped.deserialize(sample.payload.to_bytes())
    w, stamp = message.wrench, message.header.stamp
    heard.append([text(message.header.frame_id), int(stamp.sec), int(stamp.nanosec)] + [float(v) for v in (
                  w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z)])
with zenoh.open(config) as session, pyzeros.auto_context(node="judge", zenoh_session=session):
    RawSub(WrenchStamped, topic, take)
    print("listening", flush=True)
    while len(heard) < count:
        time.sleep(0.01)
    print(json.dumps(heard[:count]), flush=True)
"""
SDK_SPEAKS = """
import json, sys, time
from zenoh_ros2_sdk import ROS2Publisher
port, topic, kind, definition, type_hash = json.loads(sys.argv[1])
publisher = ROS2Publisher(topic, kind, msg_definition=definition, type_hash=type_hash, router_port=port)
types = publisher.session_mgr.store.types
number = 0
while True:
    number += 1
    now = time.time_ns()
    stamp = types["builtin_interfaces/msg/Time"](sec=now // 10**9, nanosec=now % 10**9)
    vector = types["geometry_msgs/msg/Vector3"]
    publisher.publish(
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="fts"),
        wrench=types["geometry_msgs/msg/Wrench"](
            force=vector(x=float(number), y=-0.5, z=0.25), torque=vector(x=0.1, y=0.2, z=0.3)))
    time.sleep(0.01)
"""
PYZEROS_SPEAKS = """
import json, sys, time
import pyzeros, zenoh
from ros2_pyterfaces.cydr import all_msgs
port, topic, kind, definition, type_hash = json.loads(sys.argv[1])
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [f"tcp/127.0.0.1:{port}"]}}))
with zenoh.open(config) as session, pyzeros.auto_context(node="judge", zenoh_session=session):
    publisher = pyzeros.Pub(all_msgs.WrenchStamped, topic)
    assert publisher.hash == type_hash
    number = 0
    while True:
        number += 1
        now = time.time_ns()
        message = all_msgs.WrenchStamped()
        message.header.frame_id = b"fts" if isinstance(message.header.frame_id, bytes) else "fts"
        message.header.stamp.sec, message.header.stamp.nanosec = now // 10**9, now % 10**9
        force, torque = message.wrench.force, message.wrench.torque
        force.x, force.y, force.z = float(number), -0.5, 0.25
        torque.x, torque.y, torque.z = 0.1, 0.2, 0.3
        publisher.publish(message)
        time.sleep(0.01)
"""
PYZEROS_COMPILES = """
from ros2_pyterfaces.cydr.all_msgs import WrenchStamped
WrenchStamped.deserialize(bytes(WrenchStamped().serialize()))
"""
COMPILE_S = 280.0
"""It makes a program of each message, in C, with a compiler that may have to wait for others."""
SPEAKS = {"zenoh_ros2_sdk": SDK_SPEAKS, "pyzeros": PYZEROS_SPEAKS}
HEARS = {"zenoh_ros2_sdk": SDK_HEARS, "pyzeros": PYZEROS_HEARS}


class Peer:
    """A process of somebody else's code."""

    def __init__(self, code: str, folder: Path, compiled: Path, *arguments: Any) -> None:
        self._out = folder / "peer-out"
        with self._out.open("wb") as out:
            self._popen = subprocess.Popen(
                [sys.executable, "-c", code, json.dumps(arguments)],
                stdout=out,
                stderr=out,
                cwd=folder,
                env=compiling_to(compiled),
            )

    @property
    def said(self) -> str:
        return self._out.read_text()

    def end(self) -> None:
        self._popen.kill()
        self._popen.wait()


def compiling_to(folder: Path) -> dict[str, str]:
    """Return an environment in which pyzeros keeps what it compiles."""
    return {**os.environ, "CYDR_CACHE_DIR": str(folder)}


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What pyzeros compiles, once."""
    folder = tmp_path_factory.mktemp("compiled")
    if importlib.util.find_spec("pyzeros") is not None:
        command = [sys.executable, "-c", PYZEROS_COMPILES]
        subprocess.run(command, check=True, env=compiling_to(folder), timeout=COMPILE_S)
    return folder


@pytest.fixture
def peer(tmp_path: Path, compiled: Path) -> Iterator[Callable[..., Peer]]:
    started: list[Peer] = []

    def start(code: str, *arguments: Any) -> Peer:
        folder = tmp_path / f"peer-{len(started)}"
        folder.mkdir()
        started.append(Peer(code, folder, compiled, *arguments))
        return started[-1]

    yield start
    for one in started:
        one.end()


@pytest.fixture
def port(run_module: Callable[..., Any], wait_until: Callable[..., None]) -> int:
    """A router by whose port ROS 2 may speak in domain 0."""
    number = ports.free_port()
    router = run_module("services.router", "--listen", f"tcp/127.0.0.1:{number}", "--ros2", "0")
    wait_until("the router listens", lambda: "listening on" in router.out)
    return number


@pytest.fixture
def session(port: int) -> Iterator[zenoh.Session]:
    """Of the cell, by the router's own socket."""
    made = open_client([f"tcp/127.0.0.1:{port}"], 30.0)
    yield made
    made.close()  # type: ignore[no-untyped-call]


def _skip_without(who: str) -> None:
    if importlib.util.find_spec(who) is None:
        pytest.skip(f"{who} is not installed: pip install {who.replace('_', '-')}")


@pytest.mark.parametrize("who", HEARS)
def test_what_is_felt_is_read_by_a_peer(
    who: str,
    port: int,
    session: zenoh.Session,
    peer: Callable[..., Peer],
    run_module: Callable[..., Any],
    wait_until: Callable[..., None],
) -> None:
    _skip_without(who)
    messages = Messages()
    run_module("services.ros2.out", "--connect", f"tcp/127.0.0.1:{port}")
    judge = peer(HEARS[who], port, TOPIC, WRENCH, messages.definition(WRENCH), messages.type_hash(WRENCH), FRAMES)
    wait_until("the peer listens", lambda: "listening" in judge.said)
    wait_until("both are there", lambda: {"MP", "MS"} <= {kind for kind, topic in there(session) if topic == TOPIC})
    assert ("MP", "/treenail/a/tip") in there(session)
    sent: list[list[Any]] = []
    key = KEYS.of(FT)

    def send() -> bool:
        """Send a packet of two samples, as long as it takes."""
        number = len(sent)
        loads = [(number + part, -0.5, 1e-3) for part in (0.0, 0.25)]
        t_ns = 1_764_000_000_000_000_007 + number * 10**6
        packet = FtPacket(
            sequence=2 * number + 2,
            t_ns=t_ns,
            period_ns=1000,
            force_n=(loads[0], loads[1]),
            torque_nm=((0.1, 0.2, 0.3), (0.4, 0.5, 0.6)),
        )
        for back, force, torque in zip((1000, 0), packet.force_n, packet.torque_nm, strict=True):
            sec, nanosec = divmod(t_ns - back, 10**9)
            sent.append(["tool", sec, nanosec, *force, *torque])
        session.put(key, encode(packet), encoding=encoding_of(FtPacket))
        time.sleep(0.02)
        return "[[" in judge.said

    wait_until("the peer has heard enough", send)
    heard = json.loads(judge.said.splitlines()[-1])
    first = sent.index(heard[0])
    assert heard == sent[first : first + FRAMES]


@pytest.mark.parametrize("who", SPEAKS)
def test_what_a_peer_publishes_is_felt(
    who: str,
    port: int,
    session: zenoh.Session,
    peer: Callable[..., Peer],
    run_module: Callable[..., Any],
    wait_until: Callable[..., None],
) -> None:
    _skip_without(who)
    messages, felt = Messages(), list[FtPacket]()
    subscriber = session.declare_subscriber(
        KEYS.of(FT), lambda sample: felt.append(decode(FtPacket, sample.payload.to_bytes(), str(sample.encoding)))
    )
    options = ("--topic", "/fts/wrench", "--frame", "fts", "--rate-hz", "100", "--oldest-s", "1")
    run_module("services.ros2.sensor", "--connect", f"tcp/127.0.0.1:{port}", *options)
    told = (WRENCH, messages.definition(WRENCH), messages.type_hash(WRENCH))
    judge = peer(SPEAKS[who], port, "/fts/wrench", *told)
    wait_until("it is felt", lambda: len([one for one in felt if one.status == 0]) > 20 or "Error" in judge.said)
    good = [one for one in felt if one.status == 0]
    assert len(good) > 20, judge.said
    for packet in good:
        ((x, y, z),), (torque,) = packet.force_n, packet.torque_nm
        assert (y, z, torque) == (-0.5, 0.25, (0.1, 0.2, 0.3)) and x == round(x)
    assert sorted(one.force_n[0][0] for one in good) == [one.force_n[0][0] for one in good]
    subscriber.undeclare()  # type: ignore[no-untyped-call]


def test_a_peer_of_another_distribution_is_named_and_not_read(
    port: int,
    session: zenoh.Session,
    run_module: Callable[..., Any],
    wait_until: Callable[..., None],
) -> None:
    felt: list[FtPacket] = []
    subscriber = session.declare_subscriber(
        KEYS.of(FT), lambda sample: felt.append(decode(FtPacket, sample.payload.to_bytes(), str(sample.encoding)))
    )
    process = run_module(
        "services.ros2.sensor", "--connect", f"tcp/127.0.0.1:{port}", "--topic", "/fts/wrench", "--frame", "fts"
    )
    wait_until("it says that nobody is there", lambda: "expected a publisher on /fts/wrench in domain 0" in process.out)
    messages = Messages()
    data = messages.wrench(Wrench(time.time_ns(), "fts", (1.0, 2.0, 3.0), (0.0, 0.0, 0.0)))
    attached = written(Attachment(1, time.time_ns(), bytes(16)), messages.distribution)

    def send(kind: str, type_hash: str, until: str) -> bool:
        session.put(topic_key(0, "/fts/wrench", kind, type_hash), data, attachment=attached)
        time.sleep(0.05)
        return until in process.out

    for kind, type_hash, why in (
        (WRENCH, "TypeHashNotSupported", "got 'TypeHashNotSupported': a peer of another distribution"),
        ("geometry_msgs/msg/Wrench", messages.type_hash(WRENCH), "got geometry_msgs/msg/Wrench; is it the right topic"),
    ):
        wait_until(why, partial(send, kind, type_hash, why))
    assert felt and {one.status for one in felt} <= {LOST, NOT_ZEROED}, "nothing may move"
    subscriber.undeclare()  # type: ignore[no-untyped-call]


def there(session: zenoh.Session) -> set[tuple[str, str]]:
    """Return who publishes and who hears which topic in domain 0."""
    replies = session.liveliness().get(tokens_key(0), timeout=5.0)
    told = (endpoint(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None)
    return {(one.kind, one.topic) for one in told if one is not None}
