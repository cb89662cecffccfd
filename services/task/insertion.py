"""One insertion task as a state machine: F/T samples and actions in, motions, observations and rewards out.

With no contact the peg is guided in +Z; in contact the agent decides (thesis 6.2.2, 6.5). What the task knows is what
the wrist feels and which increments were applied: never the pose of the peg.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from msgspec.structs import replace

from services.rules.bounds import Bounds
from services.rules.forces import Forces
from services.rules.guard import increment_of
from services.rules.start_pose import start_pose
from services.rules.swaps import fresh_at, known_in
from services.rules.window import Load
from services.task.rewards import Potential, cost_of_force, end_reward, reward_of_move
from services.wire.actions import Increment, guidance, increments
from services.wire.definition import Definition
from services.wire.errors import TreenailError
from services.wire.felt_noise import contact_force_n
from services.wire.messages import (
    Action,
    EpisodeSummary,
    Force,
    FtPacket,
    Home,
    JournalEpisode,
    JournalStep,
    Move,
    Moved,
    Observation,
    Outcome,
    Reward,
    Swap,
    Torque,
    Zero,
)

_SAME_MM = 1e-9
"""Depths that differ by less are one depth: they are sums of many steps."""


class Felt(NamedTuple):
    """What follows from an F/T sample: a reward that has become due, and then one thing to do."""

    reward: Reward | None
    then: Move | Observation | EpisodeSummary


class _Pending(NamedTuple):
    """A decision whose move has been made and whose reward waits for what comes next."""

    action: Action
    reward: float


@dataclass
class _Episode:
    """What the task knows of the episode under way."""

    episode: int
    first_decision: int
    depth_mm: float
    """Applied +Z less the height of the start: how far the tip is below the mouth, were nothing to give way."""
    deepest_mm: float
    """The greatest that was."""
    states: int
    swaps: int = 0
    """Swaps in force."""
    moves: int = 0
    moves_without_progress: int = 0
    force_n: float = 0.0
    """Magnitude at the last observation."""
    potential: float = 0.0
    """The shaping's there."""
    total: float = 0.0
    """Rewards so far."""
    sums: list[float] = field(default_factory=lambda: [0.0, 0.0])
    peaks: list[float] = field(default_factory=lambda: [0.0, 0.0])
    steps: list[JournalStep] = field(default_factory=list)
    zeros: list[Zero] = field(default_factory=list)
    observation: Observation | None = None
    """Waits for an action."""
    acting: Action | None = None
    """Its move is under way."""
    pending: _Pending | None = None
    summary: EpisodeSummary | None = None


class Insertion:
    """Episodes of one run, one at a time. Pure: same calls, same results."""

    def __init__(self, definition: Definition, run: str, seed: int) -> None:
        self._definition = definition
        self._run = run
        self._seed = seed
        self._known_states = 0
        self._increments, self._bounds = increments(definition.moves), Bounds(definition)
        self._potential = Potential(definition)
        self._success_mm = definition.limits.success_fraction * definition.parts.peg_height_mm
        self._contact_n = contact_force_n(definition)
        self._forces = Forces(definition)
        self.load: Load = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        """What the newest samples came to: force [N] and torque [N m]."""
        self._now = self._blank(0, 0)

    def home(self, episode: int, first_decision: int, swaps: Sequence[Swap] = ()) -> Home:
        """Begin an episode: return where to put the peg.

        ``first_decision`` counts the run's decisions before it; ``swaps`` are the run's, as far as they are known.
        """
        if fresh_at(swaps, episode, "classifier"):
            self._known_states = 0
        self._now = self._blank(episode, first_decision, known_in(swaps, episode))
        home = start_pose(self._definition, self._run, self._seed, episode)
        self._forces.home(home)
        return home

    def sense(self, moved: Moved, packet: FtPacket) -> Felt:
        """Take the samples of the window after ``moved`` and say what follows.

        Raises TareError when an episode cannot begin with them; nothing has been taken in then.
        """
        forces = self._forces
        if moved.step == 0 and forces.tares:
            self._now.zeros = [forces.tare(packet)]
        if not forces.changes_nothing:
            forces.moved(increment_of(moved))
        self.load = forces.felt(packet)
        return self.feel(moved, *self.load)

    def tare_again(self, packet: FtPacket) -> None:
        """Take samples at the start pose as the zero of all that is felt from now on: robot or sensor began anew.

        Raises TareError.
        """
        zero = self._forces.tare(packet, self._now.moves)
        before = self._now.zeros[-1] if self._now.zeros else zero
        if (before.force_n, before.torque_nm) != (zero.force_n, zero.torque_nm):
            self._now.zeros.append(zero)

    def feel(self, moved: Moved, force_n: Force, torque_nm: Torque) -> Felt:
        """Take the force [N] and torque [N m] felt after ``moved`` and say what follows."""
        if moved.step != self._now.moves or self._now.observation is not None or self._now.summary is not None:
            raise TreenailError(
                f"task: expected the reply to motion {self._now.moves}, got {moved.step} or a repetition"
            )
        force = math.hypot(*force_n)
        self._now.depth_mm += moved.dz_mm
        self._now.deepest_mm = max(self._now.deepest_mm, self._now.depth_mm)
        if self._now.moves:
            self._feel_magnitudes(force, math.hypot(*torque_nm))
        decided = self._now.acting is not None
        pending = self._settle(force)
        outcome = self._outcome(force)
        if outcome is not None:
            return Felt(self._final_reward(pending, outcome), self._finish(outcome))
        if decided and pending is not None:
            pending = pending._replace(reward=pending.reward - cost_of_force(self._definition.reward, force))
        if force < self._contact_n:
            self._now.pending = pending
            step = guidance(self._definition.moves)
            if self._deeper(step):
                self._now.moves_without_progress = 0
            return Felt(None, self._move(step))
        potential = self._potential.of(force_n, torque_nm)
        reward = None if pending is None else self._reward(pending, pending.reward, None, potential)
        self._now.pending = None
        self._now.force_n, self._now.potential = force, potential
        return Felt(reward, self._observe(force_n, torque_nm))

    def act(self, action: Action) -> Move:
        """Take the agent's decision about the last observation and return the motion to make.

        Raises TreenailError for one that is not waited for, or for no move that there is.
        """
        if self._now.observation is None or action.decision != self._now.observation.decision:
            raise TreenailError(f"task: got an action for decision {action.decision}, which is not the one waited for")
        if complaint := self.complaint(action):
            raise TreenailError(f"task: {complaint}")
        self._now.steps[-1] = replace(
            self._now.steps[-1],
            state=action.state,
            action=action.action,
            policy_version=action.policy_version,
            increment=action.increment,
        )
        self._now.states = max(self._now.states, action.state + 1)
        self._now.observation = None
        self._now.acting = action
        listed = self._increments[action.action]
        increment = listed if action.increment is None else Increment(*action.increment)
        progress = listed.dz_mm > 0.0 and self._deeper(increment)
        self._now.moves_without_progress = 0 if progress else self._now.moves_without_progress + 1
        return self._move(increment)

    def complaint(self, action: Action) -> str | None:
        """Return why a decision is for no move that there is, or None."""
        if action.action >= len(self._increments):
            return f"action: expected one below {len(self._increments)}, got {action.action}"
        if action.increment is None:
            return None
        increment = Increment(*action.increment)
        if complaint := self._bounds.complaint(increment):
            return f"action: increment: {complaint}"
        counts_as = self._bounds.counts_as(increment)
        if action.action != counts_as:
            return f"action: expected {counts_as}, as which such a move counts, got {action.action}"
        return None

    def record(self) -> JournalEpisode:
        """Return the episode so far, as the journal and catching-up workers want it."""
        return JournalEpisode(
            run=self._run,
            episode=self._now.episode,
            first_decision=self._now.first_decision,
            steps=tuple(self._now.steps),
            summary=self._now.summary,
            swaps=self._now.swaps,
            zeros=tuple(self._now.zeros),
        )

    def expect_states(self, states: int) -> None:
        """Take over the number of contact states known from earlier episodes (for the summary)."""
        self._known_states = states

    def _observe(self, force_n: Force, torque_nm: Torque) -> Observation:
        observation = Observation(
            run=self._run,
            episode=self._now.episode,
            step=self._now.moves,
            decision=self._now.first_decision + len(self._now.steps),
            force_n=force_n,
            torque_nm=torque_nm,
            swaps=self._now.swaps,
            previous_action=self._now.steps[-1].action if self._now.steps else None,
        )
        self._now.steps.append(JournalStep(step=self._now.moves, force_n=force_n, torque_nm=torque_nm))
        self._now.observation = observation
        return observation

    def _blank(self, episode: int, first_decision: int, swaps: int = 0) -> _Episode:
        depth_mm = -self._definition.start.height_mm
        return _Episode(episode, first_decision, depth_mm, depth_mm, self._known_states, swaps)

    def _move(self, increment: Increment) -> Move:
        self._now.moves += 1
        return Move(run=self._run, episode=self._now.episode, step=self._now.moves, **increment._asdict())

    def _deeper(self, increment: Increment) -> bool:
        """Return whether a motion is progress: it leads deeper than the episode was; after -Z not each +Z does."""
        return self._now.depth_mm + increment.dz_mm > self._now.deepest_mm + _SAME_MM

    def _feel_magnitudes(self, force_n: float, torque_nm: float) -> None:
        for index, value in enumerate((force_n, torque_nm)):
            self._now.sums[index] += value
            self._now.peaks[index] = max(self._now.peaks[index], value)

    def _settle(self, force_n: float) -> _Pending | None:
        """Return the decision whose reward is not yet due, with the reward of its own move."""
        if self._now.acting is None:
            return self._now.pending
        acting, self._now.acting = self._now.acting, None
        return _Pending(
            acting,
            reward_of_move(self._definition.reward, self._increments[acting.action].dz_mm, self._now.force_n, force_n),
        )

    def _outcome(self, force_n: float) -> Outcome | None:
        limits = self._definition.limits
        if force_n >= limits.collision_force_n:
            return "collision"
        if self._now.depth_mm >= self._success_mm:
            return "inserted"
        if 0 < limits.no_progress_moves < self._now.moves_without_progress:
            return "no_progress"
        return "move_limit" if self._now.moves >= limits.move_limit else None

    def _final_reward(self, pending: _Pending | None, outcome: Outcome) -> Reward | None:
        if pending is None:
            # The first touch already ended the episode: nobody decided, so nobody is taught, but it counts.
            self._now.total += end_reward(self._definition.reward, outcome, 0.0)
            return None
        return self._reward(pending, end_reward(self._definition.reward, outcome, pending.reward), outcome, 0.0)

    def _reward(self, pending: _Pending, reward: float, terminal: Outcome | None, potential: float) -> Reward:
        """Return a decision's reward, whose episode goes on at a ``potential``, or ends, where that is 0."""
        reward += self._potential.price(self._increments[pending.action.action].dz_mm, self._now.potential, potential)
        self._now.total += reward
        done = pending.action
        self._now.steps[-1] = replace(self._now.steps[-1], reward=reward)
        return Reward(
            run=self._run,
            episode=self._now.episode,
            step=done.step,
            decision=done.decision,
            reward=reward,
            terminal=terminal,
            swaps=self._now.swaps,
        )

    def _finish(self, outcome: Outcome) -> EpisodeSummary:
        moves = max(self._now.moves, 1)
        self._known_states = self._now.states
        self._now.summary = EpisodeSummary(
            run=self._run,
            episode=self._now.episode,
            episode_return=self._now.total,
            moves=self._now.moves,
            decisions=len(self._now.steps),
            mean_force_n=self._now.sums[0] / moves,
            peak_force_n=self._now.peaks[0],
            mean_torque_nm=self._now.sums[1] / moves,
            peak_torque_nm=self._now.peaks[1],
            states=self._now.states,
            outcome=outcome,
        )
        return self._now.summary
