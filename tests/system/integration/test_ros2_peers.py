"""Independent peers of ROS 2 over Zenoh, by the router of a cell: what we publish is read by them.

``zenoh-ros2-sdk`` and ``pyzeros`` are other people's, and know nothing of Treenail. Each runs in a process of its own.
"""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from services.bus import ports
from services.bus.session import open_client
from services.wire.codec import encode, encoding_of
from services.wire.keys import FT, Keys
from services.wire.messages import FtPacket

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")
pytest.importorskip("xxhash", reason="the extra ros2 is not installed")

from services.ros2.messages import WRENCH, Messages
from services.ros2.names import endpoint, tokens_key

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
HEARS = {"zenoh_ros2_sdk": SDK_HEARS, "pyzeros": PYZEROS_HEARS}


class Peer:
    """A process of somebody else's code."""

    def __init__(self, code: str, folder: Path, *arguments: Any) -> None:
        self._out = folder / "peer-out"
        with self._out.open("wb") as out:
            self._popen = subprocess.Popen(
                [sys.executable, "-c", code, json.dumps(arguments)], stdout=out, stderr=out, cwd=folder
            )

    @property
    def said(self) -> str:
        return self._out.read_text()

    def end(self) -> None:
        self._popen.kill()
        self._popen.wait()


@pytest.fixture
def peer(tmp_path: Path) -> Iterator[Callable[..., Peer]]:
    started: list[Peer] = []

    def start(code: str, *arguments: Any) -> Peer:
        folder = tmp_path / f"peer-{len(started)}"
        folder.mkdir()
        started.append(Peer(code, folder, *arguments))
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


@pytest.mark.parametrize("who", HEARS)
def test_what_is_felt_is_read_by_a_peer(
    who: str,
    port: int,
    session: zenoh.Session,
    peer: Callable[..., Peer],
    run_module: Callable[..., Any],
    wait_until: Callable[..., None],
) -> None:
    if importlib.util.find_spec(who) is None:
        pytest.skip(f"{who} is not installed: pip install {who.replace('_', '-')}")
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


def there(session: zenoh.Session) -> set[tuple[str, str]]:
    """Return who publishes and who hears which topic in domain 0."""
    replies = session.liveliness().get(tokens_key(0), timeout=5.0)
    told = (endpoint(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None)
    return {(one.kind, one.topic) for one in told if one is not None}
