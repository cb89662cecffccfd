"""Listens to a cell that is being disturbed: when decisions are made, who is alive, whether the run is over."""

from __future__ import annotations

import threading
import time
from bisect import bisect_right
from itertools import pairwise

import zenoh
from zenoh.handlers import Callback

from services.cell.client import Client
from services.wire.keys import ACTION, HEARTBEAT, REWARD, name_of
from services.wire.messages import Action, Alive, Reward


class Watch:
    """What a client sees of one run. Times are those of ``time.monotonic``."""

    def __init__(self, client: Client, run: str) -> None:
        self._run = run
        self._changed = threading.Condition()
        self._newest = -1
        self._times: list[float] = []
        self._alive: dict[str, float] = {}
        self.finished = False
        """Whether the task has said that the run is over."""
        client.subscribe(ACTION, Action, self._on_action)
        client.subscribe(REWARD, Reward, self._on_reward)
        client.subscribe(name_of(HEARTBEAT, service="task"), Alive, self._on_task)
        callback: Callback[zenoh.Sample] = Callback(self._on_token, indirect=False)
        key = client.keys.alive("*")
        self._tokens = client.session.liveliness().declare_subscriber(key, callback, history=True)

    @property
    def decisions(self) -> int:
        """How many decisions have been made for the first time while we listened."""
        return len(self._times)

    def wait(self, timeout_s: float) -> None:
        """Wait for the next thing to happen."""
        with self._changed:
            self._changed.wait(timeout_s)

    def first_after(self, moment: float) -> float | None:
        """Return when the first decision after a moment was made, or None so far."""
        index = bisect_right(self._times, moment)
        return self._times[index] if index < len(self._times) else None

    def longest_pause(self, begin: float, end: float) -> float:
        """Return the longest time [s] without a new decision between two moments."""
        inside = self._times[bisect_right(self._times, begin) : bisect_right(self._times, end)]
        moments = [begin, *inside, end]
        return max(after - before for before, after in pairwise(moments))

    def alive_since(self, name: str) -> float | None:
        """Return when a service said that it is alive, or None when it is not."""
        return self._alive.get(name)

    def _on_action(self, action: Action) -> None:
        self._note(action.run, action.decision)

    def _on_reward(self, reward: Reward) -> None:
        # Whatever the link does to actions, a reward proves that its decision was made and carried out.
        self._note(reward.run, reward.decision)

    def _note(self, run: str, decision: int) -> None:
        with self._changed:
            if run == self._run and decision > self._newest:
                self._newest = decision
                self._times.append(time.monotonic())
                self._changed.notify_all()

    def _on_task(self, task: Alive) -> None:
        with self._changed:
            self.finished = self.finished or (task.run == self._run and task.phase == "finished")
            self._changed.notify_all()

    def _on_token(self, sample: zenoh.Sample) -> None:
        name = str(sample.key_expr).rpartition("/")[2]
        with self._changed:
            if sample.kind == zenoh.SampleKind.PUT:
                self._alive[name] = time.monotonic()
            else:
                self._alive.pop(name, None)
            self._changed.notify_all()
