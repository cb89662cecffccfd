"""The least that the distributed loop could cost: the same messages over Zenoh between processes that do nothing.

``python -m experiments.bench.bare_chain ROLE ENDPOINT`` is one of those processes: ``robot`` answers queries after a
publication, as sim does; ``classifier`` and ``agent`` pass on what they get. Every payload is zeros of a given length
and begins with the lengths of those that are to follow it; keys are as long as Treenail's own.
"""

from __future__ import annotations

import os
import queue
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import zenoh
from zenoh.handlers import Callback

from services.bus.command import DIE_WITH_PARENT, die_with_parent
from services.bus.session import open_client
from services.rules.command_line import module_command
from services.wire.errors import NoAnswerError

ROBOT, FT, REWARD = "treenail/bare/move", "treenail/bare/ft", "treenail/bare/reward"
OBSERVATION, STATE, ACTION = "treenail/bare/observation", "treenail/bare/state", "treenail/bare/action"
_PASSED_ON = {"classifier": (OBSERVATION, STATE), "agent": (STATE, ACTION)}
_HEADER = struct.Struct("<HH")
_PATIENCE_S = 30.0


class Motion(NamedTuple):
    """Lengths [bytes] of a ``move`` or ``home``, the F/T sample that it causes, and its reply."""

    request: int
    ft: int
    reply: int


class Decision(NamedTuple):
    """Lengths [bytes] of an observation and of what becomes of it."""

    observation: int
    state: int
    action: int


class Rewarded(NamedTuple):
    """Length [bytes] of a reward, which nobody answers."""

    reward: int


Exchange = Motion | Decision | Rewarded


class ChainTimes(NamedTuple):
    """What a pattern took."""

    total_s: float
    motions_s: float
    decisions_s: float


class BareChain:
    """The task's end of the chain. Use ``wait`` first."""

    def __init__(self, session: zenoh.Session) -> None:
        self._actions: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
        self._replies: queue.SimpleQueue[zenoh.Reply] = queue.SimpleQueue()
        self._felt: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
        self._querier = session.declare_querier(
            ROBOT, consolidation=zenoh.ConsolidationMode.NONE, timeout=_PATIENCE_S, express=True
        )
        self._observations = _publisher(session, OBSERVATION)
        self._rewards = _publisher(session, REWARD)
        self._subscribers = [
            session.declare_subscriber(ACTION, Callback(self._actions.put, indirect=False)),
            session.declare_subscriber(FT, Callback(self._felt.put, indirect=False)),
        ]

    def play(self, pattern: Sequence[Exchange]) -> ChainTimes:
        """Exchange what ``pattern`` says, one after the other. Raises NoAnswerError when an answer does not come."""
        clock, motions_s, decisions_s = time.perf_counter, 0.0, 0.0
        began = before = clock()
        try:
            for exchange in pattern:
                self._exchange(exchange, _PATIENCE_S)
                now = clock()
                if isinstance(exchange, Motion):
                    motions_s += now - before
                else:
                    decisions_s += now - before
                before = now
        except queue.Empty:
            raise NoAnswerError(f"bare chain: expected an answer within {_PATIENCE_S:g} s, got none") from None
        return ChainTimes(before - began, motions_s, decisions_s)

    def wait(self, running: Callable[[], None]) -> None:
        """Try until the whole chain answers; ``running`` is called in between and raises when it never will.

        Raises NoAnswerError when it takes too long.
        """
        deadline = time.monotonic() + _PATIENCE_S
        while time.monotonic() < deadline:
            running()
            try:
                self._exchange(Decision(_HEADER.size, _HEADER.size, 1), 0.2)
                self._exchange(Motion(_HEADER.size, 1, 1), 0.2)
            except queue.Empty:
                continue
            self._forget_late_answers()
            return
        raise NoAnswerError(f"bare chain: expected its processes to answer within {_PATIENCE_S:g} s")

    def _exchange(self, exchange: Exchange, patience_s: float) -> None:
        if isinstance(exchange, Motion):
            payload = _payload(exchange.request, exchange.ft, exchange.reply)
            self._querier.get(handler=Callback(self._replies.put, indirect=False), payload=payload)
            self._replies.get(timeout=patience_s)
            self._felt.get(timeout=patience_s)
        elif isinstance(exchange, Decision):
            self._observations.put(_payload(exchange.observation, exchange.state, exchange.action))
            self._actions.get(timeout=patience_s)
        else:
            self._rewards.put(bytes(exchange.reward))

    def _forget_late_answers(self) -> None:
        """Drop what answers to the earlier, given up exchanges are still coming."""
        while True:
            for inbox in (self._actions, self._replies, self._felt):
                try:
                    inbox.get(timeout=0.5)
                    break
                except queue.Empty:
                    continue
            else:
                return


@contextmanager
def bare_processes(endpoint: str) -> Iterator[Callable[[], None]]:
    """Run the three other processes of the chain; gives a function that raises NoAnswerError when one has ended."""
    environment = {**os.environ, DIE_WITH_PARENT: str(os.getpid())}
    started = {
        role: subprocess.Popen(module_command("experiments.bench.bare_chain", role, endpoint), env=environment)
        for role in ("robot", *_PASSED_ON)
    }

    def running() -> None:
        for role, process in started.items():
            if process.poll() is not None:
                raise NoAnswerError(f"bare chain: expected {role} to run, it ended with status {process.returncode}")

    try:
        yield running
    finally:
        for process in started.values():
            process.kill()
        for process in started.values():
            process.wait()


def _payload(size: int, first: int, second: int) -> bytes:
    """Return zeros of a length, at least that of the header, which holds the lengths of the next two payloads."""
    return _HEADER.pack(first, second) + bytes(size - _HEADER.size)


def _publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    return session.declare_publisher(key, express=True, congestion_control=zenoh.CongestionControl.BLOCK)


def _answer(session: zenoh.Session) -> None:
    """Play the robot."""
    inbox: queue.SimpleQueue[zenoh.Query] = queue.SimpleQueue()
    ft = _publisher(session, FT)
    robot = session.declare_queryable(ROBOT, Callback(inbox.put, indirect=False))
    while robot is not None:  # held until the process is stopped
        query = inbox.get()
        with query:
            assert query.payload is not None
            felt, reply = _HEADER.unpack_from(query.payload.to_bytes())
            ft.put(bytes(felt))
            query.reply(ROBOT, bytes(reply))


def _pass_on(session: zenoh.Session, source: str, target: str) -> None:
    """Play a worker: each payload is followed by one of the first length in it, which carries the second."""
    inbox: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
    publisher = _publisher(session, target)
    subscribers = [session.declare_subscriber(source, Callback(inbox.put, indirect=False))]
    if target == ACTION:
        subscribers.append(session.declare_subscriber(REWARD, Callback(inbox.put, indirect=False)))
    while subscribers:  # held until the process is stopped
        sample = inbox.get()
        if str(sample.key_expr) != REWARD:
            size, following = _HEADER.unpack_from(sample.payload.to_bytes())
            publisher.put(_payload(size, following, 0) if size >= _HEADER.size else bytes(size))


def main(arguments: Sequence[str]) -> None:
    """Play one role until killed."""
    die_with_parent()
    role, endpoint = arguments
    session = open_client([endpoint])
    if role == "robot":
        _answer(session)
    else:
        _pass_on(session, *_PASSED_ON[role])


if __name__ == "__main__":
    main(sys.argv[1:])
