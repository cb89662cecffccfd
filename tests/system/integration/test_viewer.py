"""The viewer as a process beside a private router: what is published ends up in a recording and on late screens."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import pytest
import zenoh
from rerun.chunk import Chunk, RrdReader
from zenoh.handlers import Callback

from services.bus.routing import open_router
from services.bus.session import open_client
from services.wire.codec import decode, encode, encoding_of
from services.wire.definition import Definition
from services.wire.keys import ACTION, EPISODE, EXPERIMENT, FT, Q_TABLE, REWARD, STATE, TRUTH, Keys
from services.wire.messages import (
    Action,
    Alive,
    EpisodeSummary,
    Experiment,
    FtPacket,
    Message,
    QTable,
    Reward,
    State,
    Truth,
)

KEYS = Keys("a")
PATIENCE_S = 20.0
M = TypeVar("M", bound=Message)


def wait_until(what: str, holds: Callable[[], bool]) -> None:
    """Wait for a condition; fail when it does not come true in good time."""
    deadline, pause = time.monotonic() + PATIENCE_S, threading.Event()
    while not holds():
        assert time.monotonic() < deadline, f"never happened: {what}"
        pause.wait(0.01)


def _matches(publisher: zenoh.Publisher) -> bool:
    matching: bool = publisher.matching_status.matching  # type: ignore[attr-defined]
    return matching


@dataclass
class Cell:
    """A router, and what the rest of a cell would do: publish, and answer the viewer's questions."""

    endpoint: str
    session: zenoh.Session
    sent: int = 0
    asked: int = 0
    publishers: dict[str, zenoh.Publisher] = field(default_factory=dict)
    declared: list[object] = field(default_factory=list)

    def publish(self, name: str, *messages: Message) -> None:
        """Publish messages once somebody listens to their key."""
        if name not in self.publishers:
            self.publishers[name] = self.session.declare_publisher(
                KEYS.of(name), congestion_control=zenoh.CongestionControl.BLOCK
            )
        publisher = self.publishers[name]
        wait_until(f"{name} has a subscriber", lambda: _matches(publisher))
        for message in messages:
            publisher.put(encode(message), encoding=encoding_of(type(message)))
            self.sent += 1

    def answer(self, name: str, message: Message) -> Callable[[], int]:
        """Answer a question with a message; return how to count how often it was asked."""
        key = KEYS.of(name)
        asked: list[int] = []

        def reply(query: zenoh.Query) -> None:
            with query:
                asked.append(1)
                query.reply(key, encode(message), encoding=encoding_of(type(message)))

        handler: Callback[zenoh.Query] = Callback(reply, indirect=False)
        self.declared.append(self.session.declare_queryable(key, handler))
        return lambda: len(asked)

    def status(self) -> Alive | None:
        """Return what the viewer says of itself."""
        self.asked += 1
        replies = list(self.session.get(KEYS.alive("viewer"), timeout=PATIENCE_S))
        if len(replies) != 1 or replies[0].ok is None:
            return None
        return decode(Alive, replies[0].ok.payload.to_bytes(), str(replies[0].ok.encoding))

    def listen(self, name: str) -> list[bytes]:
        """Return a list that what others publish is added to."""
        got: list[bytes] = []
        take: Callback[zenoh.Sample] = Callback(lambda sample: got.append(sample.payload.to_bytes()), indirect=False)
        self.declared.append(self.session.declare_subscriber(KEYS.of(name), take))
        return got

    def all_taken(self) -> bool:
        """Whether the viewer has handled everything that was published."""
        status = self.status()
        return status is not None and status.handled - self.asked >= self.sent


class Viewer:
    """The process under test."""

    def __init__(self, cell: Cell, *options: str) -> None:
        command = [sys.executable, "-m", "services.viewer", "--connect", cell.endpoint, "--bind", "127.0.0.1"]
        self.process = subprocess.Popen(
            [*command, "--port", "0", "--no-web", *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        said = ""
        for said in self.process.stdout:
            if "rerun+http" in said:
                break
        assert "rerun+http" in said, self.process.communicate()
        self.url = said.split()[-1]

    def interrupt(self) -> int:
        """Stop it as Ctrl-C would; return its exit status."""
        self.process.send_signal(signal.SIGINT)
        self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[Cell]:
    endpoint = f"unixsock-stream/{tmp_path}/z"
    router = open_router([endpoint])
    session = open_client([endpoint])
    yield Cell(endpoint, session)
    session.close()  # type: ignore[no-untyped-call]
    router.close()  # type: ignore[no-untyped-call]


@pytest.fixture
def another(cell: Cell) -> Iterator[Cell]:
    """A second member of the same cell."""
    session = open_client([cell.endpoint])
    yield Cell(cell.endpoint, session)
    session.close()  # type: ignore[no-untyped-call]


@pytest.fixture
def start(cell: Cell) -> Iterator[Callable[..., Viewer]]:
    viewers: list[Viewer] = []

    def make(*options: str) -> Viewer:
        viewers.append(Viewer(cell, *options))
        return viewers[-1]

    yield make
    for viewer in viewers:
        viewer.process.kill()
        viewer.process.communicate()


def packet(number: int, fz_n: float) -> FtPacket:
    return FtPacket(sequence=number, t_ns=number, force_n=((0.5, -0.25, fz_n),), torque_nm=((0.01, 0.02, 0.03),))


def episode(number: int) -> EpisodeSummary:
    return EpisodeSummary(
        run="r1",
        episode=number,
        episode_return=-10.0 * number,
        moves=60,
        decisions=20,
        mean_force_n=0.5,
        peak_force_n=2.25,
        mean_torque_nm=0.01,
        peak_torque_nm=0.02,
        states=8,
        outcome="collision" if number == 2 else "inserted",
    )


EXPERIMENT_ANSWER = Experiment(
    run="r1",
    seed=1,
    definition=Definition(name="x"),
    definition_sha256="0" * 64,
    skill_sha256=None,
    first_policy_version=0,
    episodes=10,
    episodes_done=0,
    decisions=0,
    phase="running",
)
Q_ANSWER = QTable(
    run="r1",
    decisions=1,
    policy_version=1,
    actions=("+X", "-X", "+Y", "-Y", "+Z"),
    q=((-1.0, -2.0, -3.0, -4.0, -0.5), (-5.0, 0.0, 0.0, 0.0, 0.0)),
    visits=((1, 1, 1, 1, 1), (1, 0, 0, 0, 0)),
    best_action=(4, 1),
    digest="0" * 64,
)
POSE = (0.5, -0.25, 1.5, 1.0, 0.0, 0.0, 0.0)


def play(cell: Cell) -> None:
    """Publish a little of everything and have it all taken in."""
    counts = [cell.answer(EXPERIMENT, EXPERIMENT_ANSWER), cell.answer(Q_TABLE, Q_ANSWER)]
    cell.publish(FT, *(packet(number, -11.0 if number == 70 else -1.0) for number in range(100)))
    cell.publish(STATE, State(run="r1", episode=0, step=1, decision=0, state=5, states=6, match=0.99))
    cell.publish(ACTION, Action(run="r1", episode=0, step=1, decision=0, state=5, action=4, policy_version=1))
    cell.publish(REWARD, Reward(run="r1", episode=0, step=1, decision=0, reward=-1.0, terminal=None))
    cell.publish(TRUTH, Truth(run="r1", episode=0, step=1, flange=POSE, peg=POSE, contact=""))
    cell.publish(EPISODE, *(episode(number) for number in range(4)))
    wait_until("everything was taken", cell.all_taken)
    # A question is asked again only when its last answer is done with.
    asked = counts[1]()
    wait_until("the answers were taken", lambda: counts[0]() >= 1 and counts[1]() >= asked + 2)
    assert counts[0]() == 1, "what runs is asked once"


def chunks(path: Path) -> dict[str, list[Chunk]]:
    """Return what a recording holds, by entity."""
    found: dict[str, list[Chunk]] = {}
    with warnings.catch_warnings(action="ignore"):  # a live recording has no footer, and Rerun says so
        reader = RrdReader(path)
    for chunk in reader.stream().to_chunks():
        found.setdefault(chunk.entity_path, []).append(chunk)
    return found


def column(pieces: list[Chunk], name: str) -> list[Any]:
    """Return all rows of one column, in order, but for what is timeless, such as names of curves."""
    batches = [piece.to_record_batch() for piece in pieces if not piece.is_static]
    return [value for batch in batches for value in batch.column(name).to_pylist()]


def check_recording(path: Path) -> None:
    """Check that what ``play`` published is in a recording."""
    found = chunks(path)
    forces = column(found["/wrist/force"], "Scalars:scalars")
    assert [0.5, -0.25, -11.0] in forces, "the peak survives"
    assert [0.01, 0.02, 0.03] in column(found["/wrist/torque"], "Scalars:scalars")
    assert column(found["/decision/state"], "Scalars:scalars") == [[5.0]]
    assert column(found["/decision/action"], "Scalars:scalars") == [[4.0]]
    assert column(found["/decision/reward"], "Scalars:scalars") == [[-1.0]]
    assert column(found["/scene/peg"], "Transform3D:translation") == [[[0.5, -0.25, 1.5]]]
    assert column(found["/progress/return"], "episode") == [0, 1, 2, 3]
    assert column(found["/progress/return"], "Scalars:scalars") == [[0, 0], [-10, -5], [-20, -10], [-30, -15]]
    assert column(found["/progress/failures"], "Scalars:scalars") == [[0], [0], [1], [1]]
    lines = [text for (text,) in column(found["/log"], "TextLog:text")]
    assert [line.split()[:2] for line in lines] == [
        ["inserted", "-0.0"],
        ["inserted", "-10.0"],
        ["collision", "-20.0"],
        ["inserted", "-30.0"],
    ]
    (table,) = column(found["/agent/values"], "Tensor:data")[-1]
    assert table["shape"] == [5, 2]
    assert list(table["buffer"]) == [-1.0, -5.0, -2.0, 0.0, -3.0, 0.0, -4.0, 0.0, -0.5, 0.0]
    assert "/scene/hole" in found and "/agent/q_table" in found


def test_what_is_published_ends_up_in_the_recording(cell: Cell, start: Callable[..., Viewer], tmp_path: Path) -> None:
    viewer = start("--save", str(tmp_path / "run.rrd"))
    play(cell)
    assert viewer.interrupt() == 0
    check_recording(tmp_path / "run.rrd")


def test_who_is_killed_and_starts_again_leaves_what_was_recorded(
    cell: Cell, start: Callable[..., Viewer], tmp_path: Path
) -> None:
    before = start("--save", str(tmp_path / "run.rrd"))
    cell.publish(FT, packet(1, -3.0))
    wait_until("everything was taken", cell.all_taken)
    wait_until("it is in the file", lambda: "/wrist/force" in chunks(tmp_path / "run.rrd"))
    before.process.kill()
    before.process.communicate()
    kept = (tmp_path / "run.rrd").read_bytes()
    assert start("--save", str(tmp_path / "run.rrd")).interrupt() == 0
    assert (tmp_path / "run.rrd").read_bytes() == kept
    assert (tmp_path / "run.1.rrd").exists()


def test_who_attaches_late_sees_what_happened_before(cell: Cell, start: Callable[..., Viewer], tmp_path: Path) -> None:
    viewer = start()
    play(cell)
    late = tmp_path / "late.rrd"
    client = subprocess.Popen(
        [sys.executable, "-m", "rerun", viewer.url, "--save", str(late), "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    try:
        wait_until("the late one receives", lambda: late.exists() and late.stat().st_size > 20_000)
        assert viewer.interrupt() == 0
        client.communicate(timeout=PATIENCE_S)
    finally:
        client.kill()
        client.communicate()
    check_recording(late)


def test_what_does_not_follow_the_contract_is_counted_and_passed_over(
    cell: Cell, start: Callable[..., Viewer], tmp_path: Path
) -> None:
    viewer = start("--save", str(tmp_path / "run.rrd"))
    cell.publish(FT, episode(1))
    cell.publish(FT, packet(1, -3.0))
    wait_until("everything was taken", cell.all_taken)
    status = cell.status()
    assert status is not None
    assert status.refused == {"WrongTypeError": 1}
    assert viewer.interrupt() == 0
    assert [0.5, -0.25, -3.0] in column(chunks(tmp_path / "run.rrd")["/wrist/force"], "Scalars:scalars")


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_viewer_that_hangs_or_dies_keeps_nothing_from_the_others(
    cell: Cell, start: Callable[..., Viewer], another: Cell, number: signal.Signals
) -> None:
    viewer = start()
    got = another.listen(FT)

    def heard() -> bool:
        cell.publish(FT, packet(0, -1.0))
        return bool(got)

    wait_until("the other listens", heard)
    viewer.process.send_signal(number)
    rest = [packet(sequence, -1.0) for sequence in range(1, 3001)]  # three seconds of a cell at full speed
    cell.publish(FT, *rest)
    wait_until("the other has it all", lambda: got[-1] == encode(rest[-1]))
    assert got[-3000:] == [encode(one) for one in rest]
