"""What every robot must satisfy: services that answer ``home`` and ``move``, as processes on a real bus.

A new driver adds one function that starts it, and its name in ``RIGS``. The test is the task: it says what runs, asks
for motions and, where the robot has no sensor of its own, publishes what is felt.
"""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import zenoh

from services.bus.answers import answer_in
from services.bus.session import open_client
from services.cell.ros2 import START as ROS_START
from services.cell.ur import START_MM, arm
from services.wire.actions import Increment, increments
from services.wire.codec import encode, encoding_of
from services.wire.definition_file import definition_sha256, load
from services.wire.keys import EXPERIMENT, FT, HOME, MOVE, Keys
from services.wire.messages import Experiment, FtPacket, Home, Move, Moved, Refusal

KEYS = Keys("a")
RUN = "conformance"
RIGS = ("sim", "val2", "val2-offset-arrived", "vplus", "supervisory", "ur", "ros2")
FELT_EVERY_S = 0.01


@dataclass
class Rig:
    """One robot, and what is around it."""

    endpoint: str
    session: zenoh.Session
    run_module: Callable[..., Any]
    wait_until: Callable[..., None]
    experiment: Experiment
    feels: threading.Event = field(default_factory=threading.Event)
    """Whether F/T samples are published."""
    own_sensor: bool = False
    service: str = "robot_link"
    """Who answers motions."""

    def start(self, name: str, *options: str) -> Any:
        """Start a service."""
        return self.run_module(f"services.{name}", "--connect", self.endpoint, *options)

    def ask(self, key: str, payload: bytes, encoding: str) -> Moved | Refusal | None:
        """Return what is answered."""
        for reply in self.session.get(KEYS.of(key), payload=payload, encoding=encoding, timeout=20.0):
            return answer_in(reply, Moved)
        return None

    def home(self, episode: int = 0, **other: Any) -> Moved | Refusal | None:
        """Ask for the start of an episode."""
        start = self.experiment.definition.start
        home = Home(
            **{
                "run": RUN,
                "episode": episode,
                "x_mm": start.x_mm,
                "y_mm": start.y_mm,
                "z_mm": -start.height_mm,
                "rx_deg": start.rx_deg,
                "ry_deg": start.ry_deg,
                "rz_deg": start.rz_deg,
                **other,
            }
        )
        return self.ask(HOME, encode(home), encoding_of(Home))

    def move(self, step: int, increment: Increment, episode: int = 0, run: str = RUN) -> Moved | Refusal | None:
        """Ask for one increment."""
        move = Move(run=run, episode=episode, step=step, **increment._asdict())
        return self.ask(MOVE, encode(move), encoding_of(Move))

    def reason(self, answer: Moved | Refusal | None) -> str:
        """Return why something was refused."""
        assert isinstance(answer, Refusal), answer
        return answer.reason


def sim(rig: Rig) -> None:
    """The simulator; it is its own sensor."""
    rig.own_sensor = True
    rig.start("sim")


def emulated(rig: Rig, emulator: tuple[str, ...], link: tuple[str, ...]) -> None:
    """The robot link on the emulated controller with an ideal arm."""
    process = rig.run_module("services.robot_link.emulator", *emulator)
    rig.wait_until("the emulator listens", lambda: re.search(r"socket://\S+", process.out))
    (url,) = re.findall(r"socket://\S+", process.out)
    rig.feels.set()
    usual = ("--oldest-s", "2", "--settle-s", "0", "--withdraw-mm", "20", "--auto-resume")
    rig.start("robot_link", "--url", url, *usual, *link)


def ur(rig: Rig) -> None:
    """The UR service on its emulated controller with an ideal arm, and a sensor beside it."""
    pytest.importorskip("rtde_control", reason="pip install '.[robot_ur]'")
    address = arm().address
    process = rig.run_module("services.robot_ur.emulator", "--listen", address)
    rig.wait_until("the emulator listens", lambda: "panel on" in process.out)
    rig.feels.set()
    rig.service = "robot_ur"
    usual = ("--oldest-s", "2", "--settle-s", "0", "--withdraw-mm", "20", "--auto-resume", "--watchdog-s", "10")
    rig.start("robot_ur", "--robot", address, "--wrist", "none", "--start", START_MM, *usual)


def ros2(rig: Rig) -> None:
    """The arm of ROS 2 on its emulated controller, and a sensor beside it."""
    for extra in ("rosbags", "xxhash"):
        pytest.importorskip(extra, reason="pip install '.[ros2]'")
    rig.start("ros2.emulator")
    rig.feels.set()
    rig.service = "ros2_robot"
    topics = ("--target", "/compliance/target_frame", "--pose", "/compliance/current_pose", "--frame", "base_link")
    usual = ("--oldest-s", "2", "--settle-s", "0", "--withdraw-mm", "20", "--auto-resume", "--tell")
    way = ("--start", ROS_START, "--stride-mm", "1", "--target-hz", "500", "--steady-s", "0.02", "--within-mm", "0.001")
    rig.start("ros2.robot", *topics, *usual, *way)


MAKE: dict[str, Callable[[Rig], None]] = {
    "sim": sim,
    "val2": lambda rig: emulated(rig, (), ()),
    "val2-offset-arrived": lambda rig: emulated(
        rig, ("--convention", "val_offset", "--prompt", "arrived"), ("--prompt", "arrived", "--tell-episode")
    ),
    "vplus": lambda rig: emulated(rig, (), ("--dialect", "vplus", "--convention", "zyz", "--convention-confirmed")),
    "supervisory": lambda rig: emulated(
        rig, ("--mode", "supervisory"), ("--mode", "supervisory", "--ddcmp-listen", "0")
    ),
    "ur": ur,
    "ros2": ros2,
}


@pytest.fixture(params=RIGS)
def rig(
    request: pytest.FixtureRequest, short_path: Path, small: Path, run_module: Any, wait_until: Any
) -> Iterator[Rig]:
    endpoint = f"unixsock-stream/{short_path}/z"
    run_module("services.router", "--listen", endpoint)
    session = open_client([endpoint], 30.0)
    definition = load(str(small), [])
    experiment = Experiment(
        run=RUN,
        seed=1,
        definition=definition,
        definition_sha256=definition_sha256(definition),
        skill_sha256=None,
        first_policy_version=0,
        episodes=1,
        episodes_done=0,
        decisions=0,
        phase="running",
    )
    made = Rig(endpoint, session, run_module, wait_until, experiment)
    key = KEYS.of(EXPERIMENT)
    answering = session.declare_queryable(
        key, lambda query: query.reply(key, encode(experiment), encoding=encoding_of(Experiment))
    )
    ended = threading.Event()
    feeling = threading.Thread(target=feel, args=(made, ended))
    feeling.start()
    try:
        MAKE[request.param](made)
        made.wait_until("it is homed", lambda: isinstance(made.home(), Moved))
        yield made
    finally:
        ended.set()
        feeling.join()
    answering.undeclare()  # type: ignore[no-untyped-call]
    session.close()  # type: ignore[no-untyped-call]


def feel(rig: Rig, ended: threading.Event) -> None:
    """Publish samples of a sensor that feels nothing, as long as it shall."""
    sequence = 0
    while not ended.wait(FELT_EVERY_S):
        if rig.feels.is_set() and not rig.own_sensor:
            sequence += 1
            none = ((0.0, 0.0, 0.0),)
            packet = FtPacket(
                sequence=sequence, t_ns=time.time_ns(), period_ns=10_000_000, force_n=none, torque_nm=none
            )
            rig.session.put(KEYS.of(FT), encode(packet), encoding=encoding_of(FtPacket))


def test_motions_in_order_are_made_and_answered_with_what_was_applied(rig: Rig) -> None:
    homed = rig.home()
    assert isinstance(homed, Moved)
    assert (homed.run, homed.episode, homed.step) == (RUN, 0, 0)
    before = homed.arrived_t_ns
    for step, increment in enumerate(increments(rig.experiment.definition.moves), 1):
        answer = rig.move(step, increment)
        assert isinstance(answer, Moved), answer
        assert Increment(*(getattr(answer, name) for name in Increment._fields)) == increment
        assert (answer.run, answer.episode, answer.step) == (RUN, 0, step)
        assert answer.arrived_t_ns > before
        before = answer.arrived_t_ns
        if step in (1, 9):
            assert rig.move(step, increment) == answer, "asked again, it is not made again"


def test_other_than_the_next_motion_is_out_of_order(rig: Rig) -> None:
    rig.home()
    lateral = Increment(dx_mm=0.2)
    assert rig.reason(rig.move(2, lateral)) == "out_of_order"
    assert isinstance(rig.move(1, lateral), Moved)
    assert rig.reason(rig.move(1, Increment(dx_mm=0.1))) == "out_of_order", "another motion under the same number"
    assert rig.reason(rig.move(3, lateral)) == "out_of_order"
    assert rig.reason(rig.move(2, lateral, episode=1)) == "out_of_order"
    assert isinstance(rig.home(1), Moved)
    assert rig.reason(rig.move(2, lateral)) == "out_of_order"
    assert isinstance(rig.move(1, lateral, episode=1), Moved)


def test_the_guard_refuses_what_is_beyond_the_limits(rig: Rig) -> None:
    assert rig.reason(rig.home(x_mm=5.0)) == "guard"
    assert rig.reason(rig.home(z_mm=1.0)) == "guard"
    rig.home()
    for beyond in (Increment(dx_mm=0.41), Increment(dz_mm=-0.2), Increment(rx_deg=0.5), Increment(rz_deg=0.1)):
        assert rig.reason(rig.move(1, beyond)) == "guard"
    assert isinstance(rig.move(1, Increment(dy_mm=0.4)), Moved)


def test_foreign_and_malformed_requests_are_refused(rig: Rig) -> None:
    rig.home()
    assert rig.reason(rig.move(1, Increment(dx_mm=0.2), run="another")) == "foreign_run"
    assert rig.reason(rig.home(run="another")) == "foreign_run"
    move = Move(run=RUN, episode=0, step=1, dx_mm=0.2)
    assert rig.reason(rig.ask(MOVE, encode(move), "application/json")) == "bad_request"
    assert rig.reason(rig.ask(MOVE, encode(move)[:-3], encoding_of(Move))) == "bad_request"
    assert rig.reason(rig.ask(HOME, encode(move), encoding_of(Move))) == "bad_request"
    assert isinstance(rig.move(1, Increment(dx_mm=0.2)), Moved)


def test_nothing_moves_without_a_fresh_sample_but_home(rig: Rig) -> None:
    if rig.own_sensor:
        pytest.skip("it is its own sensor")
    rig.home()
    rig.feels.clear()
    rig.wait_until("it stands", lambda: isinstance(rig.move(99, Increment()), Refusal) and stale(rig))
    assert rig.reason(rig.move(1, Increment(dx_mm=0.2))) == "guard"
    assert isinstance(rig.home(), Moved)
    rig.feels.set()
    rig.wait_until("it moves again", lambda: isinstance(rig.move(1, Increment(dx_mm=0.2)), Moved))


def stale(rig: Rig) -> bool:
    """Return whether the robot says that it stands for want of samples."""
    for reply in rig.session.get(f"{KEYS.alive(rig.service)}?format=json", timeout=5.0):
        return reply.ok is not None and b"stands: guard: sensor" in reply.ok.payload.to_bytes()
    return False
