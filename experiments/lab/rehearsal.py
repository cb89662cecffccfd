"""One deterministic episode made again and again, with decisions that somebody else chose.

It goes through the task and the cell that a learner meets, so its numbers are those that a learner would get.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from experiments.lab.guided import told
from services.rules.motions import GuardError
from services.sim.cell import SimulatedCell
from services.task.insertion import Insertion
from services.wire.actions import INSERT
from services.wire.definition import SPREADS, Definition
from services.wire.definition_file import run_id
from services.wire.errors import TreenailError
from services.wire.messages import EpisodeSummary, Observation

_ERRORS = ("force_n", "torque_nm", "along_mm", "across_mm", "turn_deg")


@dataclass(frozen=True)
class Attempt:
    """One episode as the task and the cell made it."""

    motions: tuple[int, ...]
    """Action of every motion, guided ones included."""
    decided: tuple[bool, ...]
    """Which of the motions were decisions, shape (motions,)."""
    summary: EpisodeSummary

    @property
    def actions(self) -> tuple[int, ...]:
        """The decisions in order: what ``replay`` needs to make the episode again."""
        return tuple(motion for motion, decided in zip(self.motions, self.decided, strict=True) if decided)


class Rehearsal:
    """Makes episode 0 of a definition again and again, from home, through ``Insertion`` and ``SimulatedCell``."""

    def __init__(self, definition: Definition) -> None:
        """Build task and cell.

        Raises:
            TreenailError: start, arm or sensor is random, so that no sequence of moves has one result.
        """
        start, noise = definition.start, definition.noise
        for name, spread in (
            *((f"start.{name}", getattr(start, name)) for name in SPREADS),
            ("hole.tilt_spread_deg", definition.hole.tilt_spread_deg),
            *((f"noise.{name}", noise.scale * getattr(noise, name)) for name in _ERRORS),
        ):
            if spread != 0.0:
                raise TreenailError(f"oracle: {name}: expected 0, as the oracle plans for one start, got {spread}")
        self._run = run_id(definition, 0)
        self._task = Insertion(definition, self._run, 0)
        self._cell = SimulatedCell(definition, self._run, 0)
        self._known: dict[tuple[int, ...], Attempt | None] = {}

    def follow(self, plan: Sequence[int]) -> Attempt | None:
        """Make the motions of a plan as far as the task lets them, then press on in +Z; None when the guard refuses.

        Without contact the task steps in +Z whatever the plan says; that step is then the plan's next +Z.
        """
        key = tuple(plan)
        if key not in self._known:
            self._known[key] = self._follow(list(plan))
        return self._known[key]

    def replay(self, actions: Sequence[int]) -> EpisodeSummary:
        """Make an episode with exactly these decisions.

        Raises:
            TreenailError: the episode takes more decisions than these, or fewer.
            GuardError: the guard refuses one of the motions.
        """
        left = list(reversed(actions))
        done = self._make(lambda: left.pop() if left else INSERT, lambda: None)
        if done.actions != tuple(actions):
            raise TreenailError(f"replay: expected an episode of {len(actions)} decisions, got {len(done.actions)}")
        return done.summary

    def _follow(self, plan: list[int]) -> Attempt | None:
        left = list(reversed(plan))
        ahead = 0  # steps in +Z made by guidance before their turn

        def guided() -> None:
            nonlocal ahead
            if left and left[-1] == INSERT:
                left.pop()
            else:
                ahead += 1

        def decide() -> int:
            nonlocal ahead
            while ahead and left and left[-1] == INSERT:
                left.pop()
                ahead -= 1
            return left.pop() if left else INSERT

        try:
            return self._make(decide, guided)
        except GuardError:
            return None

    def _make(self, decide: Callable[[], int], guided: Callable[[], None]) -> Attempt:
        motions: list[int] = []
        decided: list[bool] = []
        moved, packet = self._cell.home(self._task.home(0, 0))
        while True:
            then = self._task.sense(moved, packet).then
            if isinstance(then, EpisodeSummary):
                return Attempt(tuple(motions), tuple(decided), then)
            if isinstance(then, Observation):
                action = decide()
                move = self._task.act(told(then, action))
            else:
                guided()
                action, move = INSERT, then
            motions.append(action)
            decided.append(isinstance(then, Observation))
            moved, packet = self._cell.move(move)
