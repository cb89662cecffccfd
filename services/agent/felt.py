"""The felt learner: what a move earns at once, from what is felt; what follows it, from a table over contact states.

value(a) = theta_a . phi(w) + H[state, a]. theta is a ridge regression of the (shaped) reward of that single move, one
for each line of motion (``felt_kernel``): it knows how hard the contact presses, which a class of directions does not,
and speaks for starts that it never saw. H learns by temporal differences what comes after.

A pure fold, as ``learning.Learner`` is: what was learnt is a function of the updates alone, and an action of that, of
seed, episode, step and the decision before it.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from services.agent import felt_kernel as kernel
from services.agent.learning import Learner, whole_number
from services.agent.places import Places
from services.agent.policies import best_chances, choose, faded, probabilities
from services.agent.search import FOUND, TRIED, FlatFace
from services.rules.plugins import Lesson, Opinion
from services.rules.wrench import Wrench
from services.wire.actions import lines, repeatable
from services.wire.definition import FeltModel, Moves, Policy, Thompson

LARGEST_N = 1e6
"""A component beyond this is no force that anything is learnt from."""
IN_A_ROW = "in_a_row"
"""Name in a snapshot of the insertions since the last episode that was none."""
_MOST = 1 << 53


class FeltLearner(Learner):
    """A model of what is felt beside a table; see ``services.rules.plugins.FeelingLearner`` for what it promises."""

    def __init__(self, moves: Moves, learner: FeltModel, policy: Policy, seed: int, force_per_n: float = 0.0) -> None:
        """Start with nothing learnt; ValueError as for ``Learner``.

        ``force_per_n``: what each newton [1/N] costs a move that changes nothing, which need not be learnt.
        """
        line_of, size_of = lines(moves)
        super().__init__(len(line_of), learner, policy, seed, repeatable(moves))
        self._model, self._moves, self._force_per_n = learner, moves, force_per_n
        self._lines, self._sizes = np.array(line_of, np.int64), np.array(size_of)
        count = 1 + max(line_of)
        self._theta = np.zeros((count, kernel.FEATURES))
        self._covariances = np.zeros((count, kernel.FEATURES, kernel.FEATURES))
        self._covariances[:] = np.eye(kernel.FEATURES) / learner.ridge
        self._judged = np.zeros((2, len(line_of)))
        self._flat = None if learner.search_moves == 0 else FlatFace(moves, learner)
        self._places = None if learner.revisit == 0.0 else Places(moves)
        self._in_a_row = 0

    def decide_felt(self, previous: Lesson | None, state: int, felt: Wrench, episode: int, step: int) -> int:
        """Learn from ``previous``, which led to here, and return the action to take; see ``FeelingLearner``."""
        _check_place(episode, step)
        row, wrench = self._row(state), self._wrench(felt)
        if previous is not None:
            self._fit(previous, previous.reward)
        model, deviation = self._judge(wrench)
        if previous is not None:
            most, limit = float((model + row).max()), self._model.value_limit
            part = self._model.gamma * self._counted()
            self._follow(previous, part * min(limit, max(-limit, most)))
            row = self._row(state)
        draws = self._draws.at(episode, step)
        worth = model + row
        if self._places is not None:
            worth -= self._model.revisit * self._places.ahead(episode)
        values = self._drawn(worth, deviation, episode, draws)
        if isinstance(self._policy, Thompson):
            action = int(values.argmax())
        else:
            action = choose(values.tolist(), self._policy, self.episodes_before + episode, draws.random())
        action = self._or_again(action, None if previous is None else previous.action, episode, draws)
        if self._flat is not None:
            action = self._flat.decide(action, values, felt, episode)
        if self._places is not None:
            self._places.took(action)
        return action

    def finish_felt(self, previous: Lesson) -> None:
        """Learn from the last decision of an episode; see ``FeelingLearner``.

        After too many moves without progress only the table is taught: it is none of the last move's doing. Of a
        collision's penalty the model is told as much as its limit lets through, the table the rest.
        """
        if previous.outcome == "no_progress":
            _check_reward(previous)
            self._follow(previous, previous.reward)
        else:
            told = self._fit(previous, previous.reward)
            self._follow(previous, previous.reward - told if previous.outcome == "collision" else 0.0)
        inserted = previous.outcome == "inserted"
        self._in_a_row = self._in_a_row + 1 if inserted else 0
        if self._flat is not None:
            self._flat.search.finish(inserted)

    def opinion(self, state: int, felt: Wrench, episode: int) -> Opinion:
        """Return what is thought of each action; see ``FeelingLearner``."""
        row, (model, deviation) = self._row(state), self._judge(self._wrench(felt))
        values, policy = model + row, self._policy
        when = self.episodes_before + episode
        if isinstance(policy, Thompson):
            chances = best_chances(values, policy.width * faded(policy.width_fade, when) * deviation)
        else:
            chances = probabilities(values - self._model.caution * deviation, policy, when)
        return Opinion(values, model.copy(), row.copy(), deviation.copy(), chances)

    def decide(self, previous: tuple[int, int, float] | None, state: int, episode: int, step: int) -> int:
        """Refuse: without what is felt it cannot decide."""
        raise ValueError(f"state {state}: expected what was felt in it too, got none")

    def finish(self, previous: tuple[int, int, float]) -> None:
        """Refuse, as ``decide``."""
        raise ValueError(f"state {previous[0]}: expected what was felt in it too, got none")

    def snapshot(self) -> dict[str, bytes | int]:
        """Return the table as ``Learner`` does, and the model: theta, and the upper halves of the covariances."""
        upper = np.triu_indices(kernel.FEATURES)
        halves = np.ascontiguousarray(self._covariances[:, upper[0], upper[1]])
        model = {"theta": self._theta.astype("<f8").tobytes(), "covariances": halves.astype("<f8").tobytes()}
        searched = {} if self._flat is None else self._flat.search.snapshot()
        shape = {"lines": len(self._theta), "features": kernel.FEATURES}
        return {**super().snapshot(), **shape, **model, **searched, **self._streak()}

    def restore(self, snapshot: Mapping[str, object]) -> None:
        """Take over a ``snapshot``, to the last bit. ValueError, with nothing changed, when it does not fit.

        What one that searches has learnt about that is left out by one that does not; the other way round, it begins
        to search with nothing learnt. So it is with the insertions in a row.
        """
        table = dict(snapshot)
        in_a_row = whole_number({IN_A_ROW: table.pop(IN_A_ROW, 0)}, IN_A_ROW)
        if in_a_row > _MOST:
            raise ValueError(f"snapshot: expected {IN_A_ROW} up to {_MOST}, got {in_a_row}")
        searched = {name: table.pop(name) for name in (FOUND, TRIED) if name in table}
        shape = (table.pop("lines", None), table.pop("features", None))
        expected = self._theta.shape
        if shape != expected:
            raise ValueError(f"snapshot: expected lines and features {expected}, got {shape}")
        theta = _numbers(table.pop("theta", None), self._theta.size, "theta").reshape(expected)
        upper = np.triu_indices(kernel.FEATURES)
        halves = _numbers(table.pop("covariances", None), len(theta) * len(upper[0]), "covariances")
        covariances = np.zeros_like(self._covariances)
        covariances[:, upper[0], upper[1]] = halves.reshape(len(theta), -1)
        covariances[:, upper[1], upper[0]] = halves.reshape(len(theta), -1)
        if (np.diagonal(covariances, axis1=1, axis2=2) < 0.0).any():
            raise ValueError("snapshot: expected variances of 0 or more, got less")
        flat = None if self._flat is None else FlatFace(self._moves, self._model)
        if flat is not None and searched:
            flat.search.restore(searched)
        super().restore(table)
        self._places = None if self._places is None else Places(self._moves)
        self._theta, self._covariances, self._flat, self._in_a_row = theta, covariances, flat, in_a_row

    def digest(self) -> str:
        """Return the SHA-256, in hex, of table and model: equal for equal memories."""
        model = self._theta.astype("<f8").tobytes() + self._covariances.astype("<f8").tobytes()
        searched = b"" if self._flat is None else b"".join(self._flat.search.snapshot().values())
        streak = b"".join(count.to_bytes(8, "little") for count in self._streak().values())
        return hashlib.sha256(super().digest().encode() + model + searched + streak).hexdigest()

    def _counted(self) -> float:
        """Return the part of what is thought to follow that counts now."""
        least = self._model.follow_least
        return self._model.follow * (least + (1.0 - least) * faded(self._model.follow_fade, self._in_a_row))

    def _streak(self) -> dict[str, int]:
        """Return the insertions in a row for a snapshot: nothing where nothing depends on them."""
        return {IN_A_ROW: self._in_a_row} if self._model.follow_fade > 0.0 else {}

    def _drawn(
        self, values: NDArray[np.float64], deviation: NDArray[np.float64], episode: int, draws: np.random.Generator
    ) -> NDArray[np.float64]:
        """Return what each move is taken to be worth this time, shape (actions,): drawn, with Thompson sampling."""
        policy, when = self._policy, self.episodes_before + episode
        if not isinstance(policy, Thompson):
            return values - self._model.caution * deviation
        width = policy.width * faded(policy.width_fade, when)
        drawn: NDArray[np.float64] = values + width * deviation * draws.standard_normal(values.size)
        return drawn

    def _judge(self, wrench: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what each move is thought to earn at once and the standard deviation of that, shape (actions,) each.

        They are good until the next call.
        """
        model = self._model
        kernel.judge(wrench, model.unit_n, self._lines, self._sizes, self._theta, self._covariances, self._judged)
        self._judged[0] -= self._cost(wrench)
        return self._judged[0], self._judged[1]

    def _cost(self, wrench: NDArray[np.float64]) -> float:
        """Return what the force costs a move that leaves it as it is, whatever move it is."""
        x, y, z = wrench[:3].tolist()
        return self._force_per_n * math.sqrt(x * x + y * y + z * z)

    def _fit(self, lesson: Lesson, reward: float) -> float:
        """Teach the model what a move earned at once, within the limit; return how much it was told."""
        self._row(lesson.state)
        action, wrench = self._valid_action(lesson.action, "action"), self._wrench(lesson.felt)
        _check_reward(lesson)
        model, line = self._model, int(self._lines[action])
        told = min(model.reward_limit, max(-model.reward_limit, reward))
        size, beside = float(self._sizes[action]), told + self._cost(wrench)
        theta, covariance = self._theta[line], self._covariances[line]
        kernel.fit(wrench, model.unit_n, size, beside, model.drift, 1.0 / model.ridge, theta, covariance)
        return told

    def _follow(self, lesson: Lesson, worth: float) -> None:
        """Teach the table what followed a decision."""
        state, action = lesson.state, self._valid_action(lesson.action, "action")
        self._row(state)
        self._grow(state + 1)
        visits = int(self._visits[state, action]) + 1
        rate = max(self._model.alpha_least, min(self._model.alpha, 1.0 / visits))
        old = float(self._q[state, action])
        self._q[state, action] = old + rate * (worth - old)
        self._visits[state, action] = visits
        self._version += 1

    def _wrench(self, felt: Wrench) -> NDArray[np.float64]:
        """Return what is felt as the model takes it, shape (6,). Raises ValueError."""
        gain, (force, torque) = self._model.torque_per_m, felt
        components = (*force, gain * torque[0], gain * torque[1], gain * torque[2])
        if not all(abs(component) <= LARGEST_N for component in components):
            raise ValueError(f"force and torque: expected numbers within {LARGEST_N:g}, got {components}")
        return np.array(components)


def _check_reward(lesson: Lesson) -> None:
    if not math.isfinite(lesson.reward):
        raise ValueError(f"reward in state {lesson.state}: expected a finite number, got {lesson.reward}")


def _check_place(episode: int, step: int) -> None:
    if episode < 0 or step < 0:
        raise ValueError(f"episode and step: expected 0 or more, got {episode} and {step}")


def _numbers(value: object, count: int, name: str) -> NDArray[np.float64]:
    """Return so many finite numbers from a snapshot's bytes. Raises ValueError."""
    if not isinstance(value, bytes) or len(value) != 8 * count:
        got = f"{len(value)} bytes" if isinstance(value, bytes) else type(value).__name__
        raise ValueError(f"snapshot: expected {name} to be {8 * count} bytes, got {got}")
    numbers = np.frombuffer(value, "<f8").astype(np.float64)
    if not np.isfinite(numbers).all():
        raise ValueError(f"snapshot: expected finite numbers as {name}, got others")
    return numbers
