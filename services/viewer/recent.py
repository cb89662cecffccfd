"""How the learning goes: the averages over the last ten episodes that the thesis's figures show (6.2 to 6.4)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from services.viewer.decimate import Floats
from services.wire.messages import EpisodeSummary

WINDOW = 10
"""Episodes that an average covers."""
PACE_MARKS = 30
"""Looks at how far a run is that its pace is taken from; there is one every other second, if it got on."""


@dataclass(frozen=True)
class Progress:
    """One episode and the ones before it."""

    episode: int
    episode_return: float
    mean_return: float
    """Mean return of the last ten episodes, of fewer at the start."""
    failures: int
    """How many of the last ten episodes ended otherwise than inserted."""


class Recent:
    """Remembers the last ten episodes of one run."""

    def __init__(self) -> None:
        self._newest = -1
        self._returns: deque[float] = deque(maxlen=WINDOW)
        self._failed: deque[bool] = deque(maxlen=WINDOW)

    def take(self, summary: EpisodeSummary) -> Progress | None:
        """Return where the run stands after an episode; None for one that was seen before."""
        if summary.episode <= self._newest:
            return None
        self._newest = summary.episode
        self._returns.append(summary.episode_return)
        self._failed.append(summary.outcome != "inserted")
        return Progress(
            episode=summary.episode,
            episode_return=summary.episode_return,
            mean_return=sum(self._returns) / len(self._returns),
            failures=sum(self._failed),
        )


class History:
    """The returns of a whole run in bounded room: means of equally many episodes, of more as the run grows."""

    def __init__(self, most: int = 400) -> None:
        """``most``: groups that there may be, even."""
        self._most = most
        self._group = 1
        self._groups: dict[int, tuple[float, int]] = {}
        """By number of the group: sum of its returns, and how many."""

    def take(self, episode: int, episode_return: float) -> None:
        """Add an episode that was not seen before."""
        self._add(self._groups, episode // self._group, episode_return, 1)
        while len(self._groups) > self._most:
            self._group *= 2
            merged: dict[int, tuple[float, int]] = {}
            for number, (total, count) in self._groups.items():
                self._add(merged, number // 2, total, count)
            self._groups = merged

    def bars(self) -> tuple[Floats, Floats, int]:
        """Return first episodes of the groups, their mean returns, both of shape (groups,), and a group's size."""
        numbers = sorted(self._groups)
        firsts = np.array([number * self._group for number in numbers], dtype=np.float64)
        means = np.array([self._groups[number][0] / self._groups[number][1] for number in numbers])
        return firsts, means, self._group

    @staticmethod
    def _add(groups: dict[int, tuple[float, int]], number: int, total: float, count: int) -> None:
        before, counted = groups.get(number, (0.0, 0))
        groups[number] = (before + total, counted + count)


class Pace:
    """How long the rest of a run takes, by the episodes of its last minute or so."""

    def __init__(self) -> None:
        self._marks: deque[tuple[int, int]] = deque(maxlen=PACE_MARKS)
        """When so many episodes were done."""

    def left(self, time_ns: int, done: int, length: int) -> str:
        """Return in words how long it takes from ``done`` episodes to ``length``; empty while nobody can tell."""
        if not self._marks or done > self._marks[-1][1]:
            self._marks.append((time_ns, done))
        first_ns, first = self._marks[0]
        last_ns, last = self._marks[-1]
        if last == first or done >= length:
            return ""
        return duration((length - done) * (last_ns - first_ns) * 1e-9 / (last - first))


def duration(seconds: float) -> str:
    """Return a time in words, as exactly as is of use: ``40 s``, ``12 min``, ``3 h 5 min``."""
    if seconds < 99.5:
        return f"{max(1, round(seconds))} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60} min"
