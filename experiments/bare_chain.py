"""The least that the distributed loop could cost: the same messages over Zenoh between processes that do nothing.

``python -m experiments.bare_chain ROLE ENDPOINT`` is one of those processes: ``robot`` answers queries after a
publication, as sim does; ``classifier`` and ``agent`` pass on what they get.
"""

from __future__ import annotations

import os
import queue
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import zenoh
from zenoh.handlers import Callback

from services.wire.session import open_client

_PASSED_ON = {"classifier": ("bare/observation", "bare/state"), "agent": ("bare/state", "bare/action")}
_REPLY_BYTES = 150
_FT_BYTES = 170


class BareChain:
    """The task's end of the chain."""

    def __init__(self, session: zenoh.Session) -> None:
        self._inbox: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
        self._replies: queue.SimpleQueue[zenoh.Reply] = queue.SimpleQueue()
        self._ft: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
        self._querier = session.declare_querier(
            "bare/move", consolidation=zenoh.ConsolidationMode.NONE, timeout=2.0, express=True
        )
        self._publisher = session.declare_publisher("bare/observation", express=True)
        self._subscribers = [
            session.declare_subscriber("bare/action", Callback(self._inbox.put, indirect=False)),
            session.declare_subscriber("bare/ft", Callback(self._ft.put, indirect=False)),
        ]

    def move(self, payload: bytes) -> None:
        """One query to the robot, its reply, and the F/T sample that comes with it."""
        self._querier.get(handler=Callback(self._replies.put, indirect=False), payload=payload)
        self._replies.get(timeout=5.0)
        self._ft.get(timeout=5.0)

    def decide(self, payload: bytes) -> None:
        """One observation through classifier and agent and back as an action."""
        self._publisher.put(payload)
        self._inbox.get(timeout=5.0)

    def wait(self, payload: bytes) -> None:
        """Try until the whole chain answers; it does when all processes are connected."""
        for _ in range(200):
            try:
                self._publisher.put(payload)
                self._inbox.get(timeout=0.1)
                self._querier.get(handler=Callback(self._replies.put, indirect=False), payload=payload)
                self._replies.get(timeout=0.1)
                self._ft.get(timeout=0.1)
            except queue.Empty:
                continue
            for drained in (self._inbox, self._replies, self._ft):
                while not drained.empty():
                    drained.get()
            return
        raise RuntimeError("bare chain: the processes did not answer within 20 s")


@contextmanager
def bare_processes(endpoint: str) -> Iterator[None]:
    """Run the three other processes of the chain."""
    started = [
        subprocess.Popen([sys.executable, "-m", "experiments.bare_chain", role, endpoint], env=dict(os.environ))
        for role in ("robot", *_PASSED_ON)
    ]
    try:
        yield
    finally:
        for process in started:
            process.terminate()
        for process in started:
            process.wait(5.0)


def main(arguments: Sequence[str]) -> None:
    """Play one role until stopped."""
    role, endpoint = arguments
    session = open_client([endpoint])
    inbox: queue.SimpleQueue[zenoh.Sample | zenoh.Query] = queue.SimpleQueue()
    if role == "robot":
        ft = session.declare_publisher("bare/ft", express=True)
        robot = session.declare_queryable("bare/move", Callback(inbox.put, indirect=False))
        while robot is not None:
            query = inbox.get()
            if isinstance(query, zenoh.Query):
                with query:
                    ft.put(bytes(_FT_BYTES))
                    query.reply("bare/move", bytes(_REPLY_BYTES))
    source, target = _PASSED_ON[role]
    publisher = session.declare_publisher(target, express=True)
    subscriber = session.declare_subscriber(source, Callback(inbox.put, indirect=False))
    while subscriber is not None:
        sample = inbox.get()
        if isinstance(sample, zenoh.Sample):
            publisher.put(sample.payload.to_bytes())


if __name__ == "__main__":
    main(sys.argv[1:])
