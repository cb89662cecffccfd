"""How a run is going, in numbers: the last ten episodes, and the pace."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field

from services.wire.messages import EpisodeSummary

WINDOW = 10
LINE_EVERY_S = 2.0
"""Time between lines in a log."""


@dataclass
class Progress:
    """The last ten episodes in numbers, and the pace."""

    episodes: int
    """Length of the run."""
    done: int = 0
    recent: deque[EpisodeSummary] = field(default_factory=lambda: deque(maxlen=WINDOW))
    moves: int = 0
    _pace: deque[tuple[float, int, int]] = field(default_factory=lambda: deque(maxlen=50))
    """When each of the last episodes ended, and how many moves and episodes there were by then."""

    def add(self, summary: EpisodeSummary) -> None:
        """Count one finished episode."""
        self.done = summary.episode + 1
        self.recent.append(summary)
        self.moves += summary.moves
        self._pace.append((time.monotonic(), self.moves, self.done))

    def steps_per_s(self) -> float:
        """Return the moves per second over the last episodes."""
        if len(self._pace) < 2:
            return 0.0
        (began, first, _), (ended, last, _) = self._pace[0], self._pace[-1]
        return (last - first) / max(ended - began, 1e-9)

    def left_s(self) -> float | None:
        """Return how long the rest of the run takes at the pace of the last episodes; None before there is one."""
        if len(self._pace) < 2 or self._pace[-1][2] <= self._pace[0][2]:
            return None
        (began, _, first), (ended, _, last) = self._pace[0], self._pace[-1]
        return (self.episodes - self.done) * (ended - began) / (last - first)

    def fields(self) -> dict[str, str]:
        """Return what is shown, as text by label."""
        recent = self.recent
        shown: dict[str, str] = {"episode": f"{self.done}/{self.episodes}"}
        if recent:
            shown |= {
                "return(10)": f"{sum(item.episode_return for item in recent) / len(recent):.1f}",
                "failures/10": str(sum(item.outcome != "inserted" for item in recent)),
                "force": f"{sum(item.mean_force_n for item in recent) / len(recent):.2f} N",
                "states": str(recent[-1].states),
                "steps/s": f"{self.steps_per_s():.0f}",
            }
        if (left_s := self.left_s()) is not None:
            shown["left"] = _duration(left_s)
        return shown

    def line(self) -> str:
        """Return the state of the run as one line."""
        return "  ".join(f"{label} {value}" for label, value in self.fields().items())


def _duration(seconds: float) -> str:
    """Return a time in words, such as 43 s, 5 min 20 s or 2 h 10 min."""
    minutes, rest = divmod(round(seconds), 60)
    if minutes == 0:
        return f"{rest} s"
    hours, minutes_left = divmod(minutes, 60)
    return f"{minutes} min {rest} s" if hours == 0 else f"{hours} h {minutes_left} min"
