"""Somebody who commands the robot as fast as it answers, with nobody else there: the guard needs no learner."""

from __future__ import annotations

import math
import queue
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import zenoh
from msgspec.structs import replace

from services.bus.session import open_client
from services.wire import keys as names
from services.wire.actions import Increment, increments
from services.wire.codec import decode, encode, encoding_of
from services.wire.definition import Definition
from services.wire.definition_file import load
from services.wire.messages import FtPacket, Home, Message, Move, Moved, Refusal

EPISODES = 12
FLOOD = 3000
"""Motions that are asked for without waiting for any answer."""
PRESSED = 400
"""Motions of one who hears every answer."""


class Hostile:
    """A session that commands motions and hears what the wrist feels."""

    def __init__(self, live: Any) -> None:
        self.keys = live.keys
        self.run: str = live.experiment().run
        self.definition: Definition = load(str(live.definition))
        self.session: zenoh.Session = open_client([live.endpoint])
        self.answers: queue.SimpleQueue[Moved | Refusal] = queue.SimpleQueue()
        self.felt_n: list[float] = []
        self.subscriber = self.session.declare_subscriber(self.keys.of(names.FT), self._feel)

    def ask(self, name: str, request: Message) -> None:
        """Ask for a motion and go on."""
        what: dict[str, Any] = {"payload": encode(request), "encoding": encoding_of(type(request)), "timeout": 60.0}
        self.session.get(self.keys.of(name), self._take, **what)

    def told(self, name: str, request: Message) -> Moved | Refusal:
        """Ask for a motion and return the answer."""
        self.ask(name, request)
        return self.answers.get(timeout=60.0)

    def home(self, episode: int) -> Home:
        """Return the start pose of an episode."""
        start = self.definition.start
        at = {"x_mm": start.x_mm, "y_mm": start.y_mm, "z_mm": -start.height_mm}
        turned = {"rx_deg": start.rx_deg, "ry_deg": start.ry_deg, "rz_deg": start.rz_deg}
        return Home(run=self.run, episode=episode, **at, **turned)

    def _feel(self, sample: zenoh.Sample) -> None:
        packet = decode(FtPacket, sample.payload.to_bytes(), str(sample.encoding))
        self.felt_n += [math.hypot(*force) for force in packet.force_n]

    def _take(self, reply: zenoh.Reply) -> None:
        kind: type[Moved] | type[Refusal]
        kind, part = (Refusal, reply.err) if reply.ok is None else (Moved, reply.ok)
        assert part is not None
        answer: Moved | Refusal = decode(kind, part.payload.to_bytes(), str(part.encoding))
        self.answers.put(answer)


@pytest.fixture
def hostile(live: Any) -> Iterator[Hostile]:
    """Somebody hostile in a cell of which only robot, router and store are left."""
    live.start_loop(EPISODES)
    live.wait_actions(30)
    made = Hostile(live)
    for name in ("task", "classifier", "agent"):
        live.processes[name].popen.kill()
        live.processes[name].end()
    yield made
    made.session.close()  # type: ignore[no-untyped-call]


def test_with_all_learners_dead_no_motion_goes_past_the_limits(
    live: Any, hostile: Hostile, reference: Callable[..., dict[str, str]]
) -> None:
    definition, dice = hostile.definition, np.random.default_rng(5)
    actions = increments(definition.moves)
    seen: Counter[str] = Counter()

    def note(answer: Moved | Refusal) -> None:
        """Count an answer, and check that what was made is within the limits."""
        if isinstance(answer, Refusal):
            seen[answer.reason] += 1
            return
        seen["made"] += 1
        moves = definition.moves
        assert max(abs(answer.dx_mm), abs(answer.dy_mm)) <= moves.lateral_mm
        assert 0.0 <= answer.dz_mm <= moves.insertion_mm
        assert max(abs(answer.rx_deg), abs(answer.ry_deg)) <= moves.rotation_deg
        assert answer.rz_deg == 0.0
        assert answer.step <= definition.limits.move_limit

    # One that does not listen: any motion, of any size, at any place in the episode.
    note(hostile.told(names.HOME, hostile.home(0)))
    for number in range(FLOOD):
        size = float(dice.choice([1.0, 1.0, 1.5, 20.0, 500.0]))
        increment = Increment(*(size * value for value in actions[int(dice.integers(len(actions)))]))
        step = number // 50 + int(dice.integers(1, 4))
        run = hostile.run if dice.random() < 0.95 else "another-s0"
        hostile.ask(names.MOVE, Move(run=run, episode=0, step=step, **increment._asdict()))
    for _ in range(FLOOD):
        note(hostile.answers.get(timeout=60.0))
    assert seen["guard"] > 0
    assert min(seen["out_of_order"], seen["foreign_run"]) > 100

    # One that does: down in full steps, or all to one side, until nothing but home is left; and homes into the wall.
    wild = replace(hostile.home(1), x_mm=definition.start.x_mm + 10.0, z_mm=5.0)
    episode, step, made = 0, definition.limits.move_limit, 0
    way = actions
    while made < PRESSED:
        pressing = way[int(dice.integers(len(way)))]
        answer = hostile.told(names.MOVE, Move(run=hostile.run, episode=episode, step=step + 1, **pressing._asdict()))
        note(answer)
        if isinstance(answer, Moved):
            step, made = step + 1, made + 1
            continue
        note(hostile.told(names.HOME, wild))
        episode, step = episode + 1, 0
        way = (Increment(dz_mm=definition.moves.insertion_mm), *actions[: int(dice.integers(9))])
        note(hostile.told(names.HOME, hostile.home(episode)))
    assert hostile.answers.empty()
    assert seen["bad_request"] == 0
    assert definition.limits.collision_force_n < max(hostile.felt_n) < definition.limits.hard_force_n

    # The robot has outlived it, and the run goes on as if nothing had been.
    live.start_loop(EPISODES, "task", "classifier", "agent")
    assert live.digests() == reference(EPISODES)
