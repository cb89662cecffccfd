"""A run's journal as rows, one a motion: what was felt, decided and earned, and where the tip was commanded to. Pure.

The journal has the decisions. The motions between them are the task's own, known by their number: steps of guidance in
+Z, made because less than ``limits.contact_force_n`` was felt. How much less nobody wrote down.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from services.sim.pose import Pose
from services.task.insertion import Insertion
from services.wire.actions import Increment, action_names, guidance, increments
from services.wire.definition import Definition
from services.wire.errors import TreenailError
from services.wire.messages import EpisodeSummary, Force, JournalEpisode, JournalStep, Torque

MOTION_NS = 20_000_000
"""Time between motions on the clock of steps. The journal has no times: its runs end in the same bytes."""


class Row(NamedTuple):
    """One motion."""

    episode: int
    motion: int
    """Number within the episode, from 1."""
    t_ns: int
    """On the clock of steps: 20 ms a motion, from the run's first one on."""
    decision: int | None
    """Number within the run; None, as all that follows up to ``reward``, for guidance."""
    force_n: Force | None
    """Felt before the motion, tool frame."""
    torque_nm: Torque | None
    state: int | None
    action: int | None
    action_name: str
    """``guidance`` for a step of the task's own."""
    policy_version: int | None
    reward: float | None
    """None for guidance, and for a decision that was taught nothing."""
    flange: Pose
    """Commanded pose of the tip before the motion, in the frame of the hole as it stands upright."""
    increment: Increment
    """Of the motion, tool frame."""
    outcome: str
    """How the episode ended, in the row of its last motion; else empty."""

    @property
    def decided(self) -> bool:
        """Whether an agent decided about the motion."""
        return self.decision is not None


class EpisodeRows(NamedTuple):
    """One episode."""

    summary: EpisodeSummary
    rows: list[Row]
    end_ns: int
    """When it was over, on the clock of steps."""


class Stepper:
    """Turns journal entries, in their order, into rows."""

    def __init__(self, definition: Definition, run: str, seed: int) -> None:
        self._task = Insertion(definition, run, seed)
        self._names, self._increments = action_names(definition.moves), increments(definition.moves)
        self._guidance, self._centre_mm = guidance(definition.moves), definition.moves.rotation_centre_mm
        self._t_ns = 0

    def episodes(self, journal: Iterable[JournalEpisode]) -> Iterator[EpisodeRows]:
        """Give the finished episodes. Raises TreenailError for one that cannot have been."""
        for entry in journal:
            if entry.summary is not None:
                rows = list(self._rows(entry, entry.summary))
                self._t_ns += MOTION_NS * (len(rows) + 1)
                yield EpisodeRows(entry.summary, rows, self._t_ns - MOTION_NS)

    def _rows(self, entry: JournalEpisode, summary: EpisodeSummary) -> Iterator[Row]:
        home = self._task.home(entry.episode, entry.first_decision)
        pose = Pose.from_tilt(home.x_mm, home.y_mm, home.z_mm, home.rx_deg, home.ry_deg, home.rz_deg)
        decided = {step.step: (entry.first_decision + place, step) for place, step in enumerate(entry.steps)}
        if any(step >= summary.moves for step in decided):
            got = f"a decision after motion {max(decided)}"
            raise TreenailError(f"episode {entry.episode}: expected decisions in {summary.moves} motions, got {got}")
        for motion in range(1, summary.moves + 1):
            decision, step = decided.get(motion - 1, (None, None))
            increment = self._guidance if step is None else self._made(step)
            yield Row(
                episode=entry.episode,
                motion=motion,
                t_ns=self._t_ns + MOTION_NS * (motion - 1),
                decision=decision,
                force_n=None if step is None else step.force_n,
                torque_nm=None if step is None else step.torque_nm,
                state=None if step is None else step.state,
                action=None if step is None else step.action,
                action_name="guidance" if step is None else self._names[step.action or 0],
                policy_version=None if step is None else step.policy_version,
                reward=None if step is None else step.reward,
                flange=pose,
                increment=increment,
                outcome=summary.outcome if motion == summary.moves else "",
            )
            pose = pose.moved(increment, self._centre_mm)

    def _made(self, step: JournalStep) -> Increment:
        if step.action is None or step.action >= len(self._increments):
            raise TreenailError(
                f"step {step.step}: expected an action below {len(self._increments)}, got {step.action}"
            )
        return self._increments[step.action] if step.increment is None else Increment(*step.increment)
