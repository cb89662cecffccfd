"""Disturbs one cell by its part of the plan until its run is over, and measures how long it takes to learn again."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from experiments.chaos.cell import ChaosCell
from experiments.chaos.disturb import disturbing
from experiments.chaos.plan import Disturbance
from experiments.chaos.watch import Watch
from services.wire.errors import CellError

PATIENCE_S = 120.0
"""A cell that has not gone on learning for so long will not do it any more."""
LOOK_S = 0.005
FELT_S = 1.0
"""A disk is full until nothing has been decided for so long: only when an episode ends does the store have to write."""


class Done(NamedTuple):
    """One disturbance that was carried out."""

    planned: Disturbance
    pause_s: float | None
    """Longest time without a new decision from its beginning until all was as before; None when the run ended."""
    restart_s: float | None
    """From the start of the last process that it had killed to the first new decision with all alive again."""
    recovered: bool = True


def drive(
    cell: ChaosCell, watch: Watch, todo: deque[Disturbance], done: list[Done], tell: Callable[[Done], None]
) -> None:
    """Do to a cell what is to be done, until its run is over. Raises CellError when it stops learning for good."""
    under_way: _UnderWay | None = None
    counted, moved = 0, time.monotonic()
    seen = 0

    def note(outcome: Done) -> None:
        done.append(outcome)
        tell(outcome)

    while not watch.finished:
        cell.check()
        if watch.decisions > seen or (under_way is not None and not under_way.over):
            seen, moved = watch.decisions, time.monotonic()
        if time.monotonic() - moved > PATIENCE_S:
            raise _stuck(done, under_way)
        if under_way is not None:
            result = under_way.look()
            if result is not None:
                note(result)
                under_way, counted = None, watch.decisions
        elif todo and watch.decisions - counted >= todo[0].after and all(map(cell.runs, todo[0].victims)):
            under_way = _UnderWay(todo.popleft(), cell, watch)
        watch.wait(LOOK_S)
    if under_way is not None:
        note(under_way.at_the_end())


def _stuck(done: list[Done], under_way: _UnderWay | None) -> CellError:
    planned = under_way.planned if under_way is not None else done[-1].planned if done else None
    after = "its start" if planned is None else " ".join((planned.kind, *planned.victims))
    if under_way is not None:
        done.append(Done(under_way.planned, None, None, recovered=False))
    return CellError(f"chaos: expected the cell to go on learning after {after}, nothing for {PATIENCE_S:g} s")


class _UnderWay:
    """A disturbance that has begun and that the cell has not got over yet."""

    def __init__(self, planned: Disturbance, cell: ChaosCell, watch: Watch) -> None:
        self.planned = planned
        self.over = 0.0
        """When it ended; 0 before."""
        self._cell = cell
        self._watch = watch
        self._what = disturbing(planned)
        self._begun = time.monotonic()
        self._what.begin(cell)

    def look(self) -> Done | None:
        """End it when it is time; return how it went once the cell has got over it."""
        if not self.over:
            if not self._due():
                return None
            self._end()
        ready = self._ready()
        learning = None if ready is None else self._watch.first_after(ready)
        if learning is None:
            return None
        starts = [started for name in self.planned.killed if (started := self._cell.started(name)) is not None]
        pause_s = self._watch.longest_pause(self._begun, learning)
        return Done(self.planned, pause_s, learning - max(starts) if starts else None)

    def _due(self) -> bool:
        """Return whether it is time to end it."""
        now, planned = time.monotonic(), self.planned
        if now < self._begun + planned.lasts_s:
            return False
        if planned.kind == "again":
            return self._cell.runs(planned.victims[1])  # else there is nothing to kill at this moment
        return planned.kind != "full-disk" or self._watch.first_after(now - FELT_S) is None

    def at_the_end(self) -> Done:
        """End it because the run has ended, and wait until all that it had killed is alive again."""
        if not self.over:
            self._end()
        deadline = time.monotonic() + PATIENCE_S
        while self._ready() is None and time.monotonic() < deadline:
            self._cell.check()
            self._watch.wait(LOOK_S)
        return Done(self.planned, None, None, recovered=self._ready() is not None)

    def _end(self) -> None:
        self._what.end(self._cell)
        self.over = time.monotonic()

    def _ready(self) -> float | None:
        """Return from when on all was in place again, or None so far."""
        moments = [self.over]
        for name in self.planned.victims if self.planned.kind != "skew" else ():
            started, alive = self._cell.started(name), self._watch.alive_since(name)
            if started is None or (name in self.planned.killed and started < self._begun):
                return None
            if name == "router":  # it says nothing; all decisions go through it
                moments.append(started)
            elif alive is None or alive < started:
                return None
            else:
                moments.append(alive)
        return max(moments)
