"""The environment as a run of Treenail has it: one seed, episodes by number, and what came of each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium

from experiments.leaderboard.jobs import Outcome
from experiments.reproduce.insertion_runs import LETTERS

REFUSED = "r"
"""Letter of an episode whose next motion the guard beside the robot refused."""


class Numbered(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Goes through the episodes 0, 1, 2, ... of one seed, whoever resets it and with whatever seed, and notes them.

    A library of learners resets with the seed of its own dice, and again when an episode is over. Starts and noise are
    those of ``treenail experiment run`` with this seed all the same.
    """

    def __init__(
        self, env: gymnasium.Env[Any, Any], seed: int, heard: Callable[[int], object] = lambda _: None
    ) -> None:
        """``heard`` is told after each episode how many are over."""
        super().__init__(env)
        self._seed: int | None = seed
        self._heard = heard
        self._return = 0.0
        self.steps = 0
        """Decisions made, in all."""
        self.clear()

    def clear(self) -> None:
        """Forget what has been noted."""
        self._letters = ""
        self._returns, self._force_n, self._peak_n = list[float](), list[float](), list[float]()
        self._moves = list[int]()

    @property
    def over(self) -> int:
        """How many episodes have been noted."""
        return len(self._letters)

    def outcome(self, episodes: int, cpu_s: float) -> Outcome:
        """Return what came of the first ``episodes`` that have been noted."""
        some = slice(episodes)
        return Outcome(
            self._letters[some],
            self._returns[some],
            self._force_n[some],
            self._peak_n[some],
            self._moves[some],
            states=0,
            cpu_s=cpu_s,
        )

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin the next episode, or the one that ``options`` name; another ``seed`` than the run's is not heard.

        An episode that ends at its first touch leaves nothing to decide and nothing to learn, and is noted all the
        same: everybody else's curves have a point there.
        """
        felt, info = self.env.reset(seed=self._seed, options=options)
        self._seed, self._return = None, 0.0
        for passed in info["passed"]:
            self._note(passed)
        return felt, info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Decide, and note the episode when it is over."""
        felt, reward, terminated, truncated, info = self.env.step(action)
        self._return += float(reward)
        self.steps += 1
        if terminated or truncated:
            self._note(info)
        return felt, float(reward), terminated, truncated, info

    def _note(self, info: dict[str, Any]) -> None:
        self._letters += LETTERS.get(info["outcome"], REFUSED)
        self._returns.append(self._return)
        self._force_n.append(info["mean_force_n"])
        self._peak_n.append(info["peak_force_n"])
        self._moves.append(info["moves"])
        self._heard(self.over)
