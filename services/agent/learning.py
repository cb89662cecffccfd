"""The tabular learner: Q-learning and SARSA over numbered states (thesis 4.2.2), one-step or with traces.

A pure fold: the table is a function of the updates alone, and an action of (table, seed, episode, step), never of
what was asked before or how often.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from services.agent.policies import choose, goes_on, probabilities
from services.agent.traces import Traces
from services.wire.actions import INSERT
from services.wire.definition import Exploring, FeltModel, Policy, Sarsa, TdSettings
from services.wire.randomness import MAX_SEED, Draws, Role

MAX_STATES = 1_000_000
"""States are numbered below this: a wrong number is refused rather than given gigabytes of zeros."""


class Learner:
    """Action values Q, shape (states, actions), all 0 at first, with the number of updates of each.

    States are numbers in 0..MAX_STATES-1, actions in 0..actions-1. The table ends with the highest state that was
    ever updated; every other state counts as a row of zeros. Every refused call leaves the learner as it was.
    """

    def __init__(
        self,
        actions: int,
        learner: TdSettings | FeltModel,
        policy: Policy,
        seed: int,
        repeatable: Sequence[bool] = (),
    ) -> None:
        """Start with an empty table; ``actions`` is at least 1, ``seed`` in 0..2**63-1, ValueError otherwise.

        ``repeatable`` says of each action whether exploration may go on with it; by default all but +Z.
        """
        if actions < 1:
            raise ValueError(f"number of actions: expected 1 or more, got {actions}")
        if not 0 <= seed <= MAX_SEED:
            raise ValueError(f"seed: expected 0 to {MAX_SEED}, got {seed}")
        self._learner = learner
        self._policy = policy
        self._draws = Draws(seed, Role.POLICY)
        self._repeatable = tuple(repeatable) or tuple(action != INSERT for action in range(actions))
        decay = learner.gamma * learner.trace if isinstance(learner, TdSettings) else 0.0
        self._traces = Traces(decay) if decay > 0.0 else None
        self._blank = np.zeros(actions)
        # Both grow by doubling; only the first `_states` rows count.
        self._q = np.zeros((0, actions))
        self._visits = np.zeros((0, actions), np.int64)
        self._states = 0
        self._version = 0
        self.episodes_before = 0
        """Episodes that the table was learnt in before this run: the policy's schedule goes on from there."""

    @property
    def states(self) -> int:
        """Number of rows: 1 + the highest state updated so far, 0 before the first update."""
        return self._states

    @property
    def actions(self) -> int:
        """Number of actions."""
        return self._blank.size

    @property
    def version(self) -> int:
        """Number of updates so far."""
        return self._version

    @property
    def q(self) -> NDArray[np.float64]:
        """Copy of the action values, shape (states, actions)."""
        return self._q[: self._states].copy()

    @property
    def visits(self) -> NDArray[np.int64]:
        """Copy of the number of updates of each value, shape (states, actions)."""
        return self._visits[: self._states].copy()

    def values(self, state: int) -> NDArray[np.float64]:
        """Return a copy of the values of ``state``, shape (actions,), zeros if it was never updated.

        ValueError when ``state`` is out of range.
        """
        return self._row(state).copy()

    def chances(self, state: int, episode: int) -> NDArray[np.float64]:
        """Return the probability of each action in ``state`` in this run's ``episode``, shape (actions,).

        ValueError when a number is out of range.
        """
        return probabilities(self._row(state), self._policy, self.episodes_before + episode)

    def act(self, state: int, episode: int, step: int, before: int | None = None) -> int:
        """Return the policy's action in ``state`` at ``step`` of ``episode`` (both 0 or more); changes nothing.

        ``before`` is the decision before it in the episode, which exploration may go on with. ValueError when a number
        is out of range.
        """
        _check_time(episode, step)
        values: list[float] = self._row(state).tolist()
        draws = self._draws.at(episode, step)
        action = choose(values, self._policy, self.episodes_before + episode, draws.random())
        return self._or_again(action, before, episode, draws)

    def best_action(self, state: int) -> int:
        """Return an action of the highest value in ``state``, the lowest-numbered one of several."""
        return int(self._row(state).argmax())

    def update(self, state: int, action: int, reward: float, next_state: int | None, next_action: int | None) -> None:
        """Learn from one transition; ``next_state`` None says that the episode ended with it.

        Q-learning moves Q(state, action) towards reward + gamma * max Q(next_state) and ignores ``next_action``
        (thesis eq. 4.4); SARSA towards reward + gamma * Q(next_state, next_action) (eq. 4.5); after the end both
        towards the reward alone. ValueError when a number is out of range, the reward or the new value is not
        finite, or SARSA is not told the next action.
        """
        old = float(self._row(state)[self._valid_action(action, "action")])
        if not math.isfinite(reward):
            raise ValueError(f"reward in state {state}: expected a finite number, got {reward}")
        worth = 0.0 if next_state is None else self.next_value(next_state, next_action)
        target = float(reward) + self._learner.gamma * worth
        new = old + self._learner.alpha * (target - old)
        if not math.isfinite(new):
            raise ValueError(f"value of state {state}, action {action}: expected a finite number, got {new}")
        self._grow(state + 1)
        if self._traces is not None:
            self._share(self._traces, state, action, target - old)
        self._q[state, action] = new
        self._visits[state, action] += 1
        self._version += 1

    def next_value(self, state: int, action: int | None) -> float:
        """Return what it is worth to come to ``state``, where ``action`` is taken next (None for Q-learning).

        This is where one-step learners differ: a learner of another kind is a subclass with its own. Raises ValueError.
        """
        row = self._row(state)
        if not isinstance(self._learner, Sarsa):
            values: list[float] = row.tolist()
            return max(values)
        if action is None:
            raise ValueError(f"SARSA: expected the action taken in next state {state}, got none")
        return float(row[self._valid_action(action, "next action")])

    def decide(self, previous: tuple[int, int, float] | None, state: int, episode: int, step: int) -> int:
        """Learn from ``previous`` (state, action, reward), which led to ``state``, and return the action to take there.

        ``previous`` is None at an episode's first decision. Q-learning learns, then acts; SARSA must act first, since
        it learns from that action. Raises ValueError as ``act`` and ``update`` do.
        """
        if previous is None:
            if self._traces is not None:
                self._traces.clear()
            return self.act(state, episode, step)
        before = previous[1]
        if isinstance(self._learner, Sarsa):
            action = self.act(state, episode, step, before)
            self.update(*previous, state, action)
            return action
        # What could refuse to act is checked before learning, so that a refusal leaves no half-done step.
        _check_time(episode, step)
        self.update(*previous, state, None)
        action = self.act(state, episode, step, before)
        if self._traces is not None and self._row(state)[action] < self._row(state).max():
            self._traces.clear()  # Watkins: what comes of a move that is not the best says nothing of those before
        return action

    def finish(self, previous: tuple[int, int, float]) -> None:
        """Learn from the last (state, action, reward) of an episode. Raises ValueError as ``update`` does."""
        self.update(*previous, None, None)
        if self._traces is not None:
            self._traces.clear()

    def snapshot(self) -> dict[str, bytes | int]:
        """Return the table in plain types: counts, q as little-endian f64 and visits as i64, both row by row."""
        return {
            "actions": self.actions,
            "states": self._states,
            "version": self._version,
            "q": self.q.astype("<f8").tobytes(),
            "visits": self.visits.astype("<i8").tobytes(),
        }

    def restore(self, snapshot: Mapping[str, object]) -> None:
        """Take over the table of a ``snapshot``, to the last bit.

        ValueError when a field is missing, unknown or of the wrong type, the number of actions is another, sizes do
        not fit, a value is not finite, or the visits are negative, do not add up to the version or end in a row
        without any.
        """
        expected = {"actions", "states", "version", "q", "visits"}
        if set(snapshot) != expected:
            raise ValueError(f"snapshot: expected the fields {sorted(expected)}, got {sorted(snapshot)}")
        actions, states, version = (whole_number(snapshot, name) for name in ("actions", "states", "version"))
        if actions != self.actions:
            raise ValueError(f"snapshot: expected {self.actions} actions, got {actions}")
        if states > MAX_STATES:
            raise ValueError(f"snapshot: expected at most {MAX_STATES} states, got {states}")
        q = np.frombuffer(_block(snapshot, "q", 8 * states * actions), "<f8").reshape(states, actions)
        visits = np.frombuffer(_block(snapshot, "visits", 8 * states * actions), "<i8").reshape(states, actions)
        if not np.isfinite(q).all():
            raise ValueError("snapshot: expected finite action values, got NaN or infinity")
        if (visits < 0).any() or int(visits.sum()) != version or (states > 0 and not visits[-1].any()):
            raise ValueError(
                f"snapshot: expected visits of 0 or more that add up to version {version} with some in the last of "
                f"{states} states, got {int(visits.sum())} in all"
            )
        self._q, self._visits = q.astype(np.float64), visits.astype(np.int64)
        self._states, self._version = states, version
        if self._traces is not None:
            self._traces.clear()

    def digest(self) -> str:
        """Return the SHA-256, in hex, of shape, q (f64) and visits (i64), little-endian: equal for equal tables."""
        shape = np.array([self._states, self.actions], "<i8").tobytes()
        return hashlib.sha256(shape + self.q.astype("<f8").tobytes() + self.visits.astype("<i8").tobytes()).hexdigest()

    def _share(self, traces: Traces, state: int, action: int, error: float) -> None:
        """Let earlier decisions of the episode share in what the last one's value was wrong by. Raises ValueError."""
        changed = {}
        for at, taken, share in traces.shares():
            if (at, taken) != (state, action):
                changed[at, taken] = float(self._q[at, taken]) + self._learner.alpha * error * share
        if not all(map(math.isfinite, changed.values())):
            raise ValueError(f"values before state {state}: expected finite numbers, got others")
        for place, value in changed.items():
            self._q[place] = value
        traces.mark(state, action)
        traces.fall()

    def _or_again(self, action: int, before: int | None, episode: int, draws: np.random.Generator) -> int:
        """Return the action, or the one before it where exploration goes on with that."""
        policy = self._policy
        if before is None or not isinstance(policy, Exploring) or policy.repeat == 0.0:
            return action
        goes = self._repeatable[before] and goes_on(policy, self.episodes_before + episode, draws.random())
        return before if goes else action

    def _row(self, state: int) -> NDArray[np.float64]:
        """Return the values of ``state``, shape (actions,), not to be written to."""
        if not 0 <= state < MAX_STATES:
            raise ValueError(f"state: expected 0 to {MAX_STATES - 1}, got {state}")
        return self._q[state] if state < self._states else self._blank

    def _valid_action(self, action: int, name: str) -> int:
        if not 0 <= action < self.actions:
            raise ValueError(f"{name}: expected 0 to {self.actions - 1}, got {action}")
        return action

    def _grow(self, states: int) -> None:
        """Make the table at least ``states`` rows long."""
        if states > len(self._q):
            more = ((0, max(states, 2 * len(self._q)) - len(self._q)), (0, 0))
            self._q, self._visits = np.pad(self._q, more), np.pad(self._visits, more)
        self._states = max(self._states, states)


def _check_time(episode: int, step: int) -> None:
    if episode < 0 or step < 0:
        raise ValueError(f"episode and step: expected 0 or more, got {episode} and {step}")


def whole_number(snapshot: Mapping[str, object], name: str) -> int:
    """Return a whole number of 0 or more from a snapshot. Raises ValueError."""
    value = snapshot[name]
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"snapshot: expected {name} to be a whole number of 0 or more, got {value!r}")
    return value


def _block(snapshot: Mapping[str, object], name: str, size: int) -> bytes:
    """Return ``size`` bytes from a snapshot."""
    value = snapshot[name]
    if not isinstance(value, bytes) or len(value) != size:
        got = f"{len(value)}" if isinstance(value, bytes) else type(value).__name__
        raise ValueError(f"snapshot: expected {name} to be {size} bytes, got {got}")
    return value
