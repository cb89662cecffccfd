"""What a tap does with messages on their way: they get lost, late, twice, or are overtaken."""

from __future__ import annotations

import heapq
import itertools
import queue
import random
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import zenoh

DELAY_S = (0.005, 0.5)
REPEAT_S = (0.0, 1.0)
OVERTAKEN_WITHIN_S = 0.3
"""A message that waits for the next one to overtake it goes on after this."""
Job: TypeAlias = Callable[[], None]


@dataclass(frozen=True)
class Faults:
    """Parts (0 to 1) of the messages that something is done to."""

    lose: float = 0.0
    delay: float = 0.0
    repeat: float = 0.0
    reorder: float = 0.0


class Line:
    """The loop that everything goes through: jobs at once, later, or when the next message overtakes them."""

    def __init__(self, seed: int) -> None:
        self.faults = Faults()
        self.counts: Counter[str] = Counter()
        self.stopping = False
        self._draw = random.Random(seed)
        self._inbox: queue.SimpleQueue[Job] = queue.SimpleQueue()
        self._later: list[tuple[float, int, Job]] = []
        self._numbers = itertools.count()
        self._overtaken: dict[str, Job] = {}
        """By direction, the message that waits to be overtaken."""

    def post(self, job: Job) -> None:
        """Have the loop do something; safe from any thread, and never waits."""
        self._inbox.put(job)

    def work(self) -> None:
        """Do what is due until stopped."""
        while not self.stopping:
            try:
                self._next()()
            except zenoh.ZError:  # who asked has gone meanwhile
                self.counts["undeliverable"] += 1

    def _next(self) -> Job:
        """Wait for the next job: what has become due first, or else what came in."""
        while True:
            left = self._later[0][0] - time.monotonic() if self._later else 1.0
            if left <= 0:
                return heapq.heappop(self._later)[2]
            try:
                return self._inbox.get(timeout=left)
            except queue.Empty:
                continue

    def message(self, direction: str, send: Job) -> None:
        """Pass a message on in a direction, after the faults have been at it."""
        faults, draw = self.faults, self._draw
        self.counts["messages"] += 1
        if draw.random() < faults.lose:
            self.counts["lost"] += 1
            return
        if draw.random() < faults.repeat:
            self.counts["repeated"] += 1
            self._in(draw.uniform(*REPEAT_S), send)
        if draw.random() < faults.delay:
            self.counts["delayed"] += 1
            self._in(draw.uniform(*DELAY_S), send)
        elif direction not in self._overtaken and draw.random() < faults.reorder:
            self._overtaken[direction] = send
            self._in(OVERTAKEN_WITHIN_S, lambda: self._let_go(direction, send))
        else:
            send()
            waiting = self._overtaken.get(direction)
            if waiting is not None:
                self.counts["reordered"] += 1
                self._let_go(direction, waiting)

    def _let_go(self, direction: str, send: Job) -> None:
        if self._overtaken.get(direction) is send:
            del self._overtaken[direction]
            send()

    def _in(self, seconds: float, job: Job) -> None:
        heapq.heappush(self._later, (time.monotonic() + seconds, next(self._numbers), job))
