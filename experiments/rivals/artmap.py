"""Fuzzy ARTMAP: classes of inputs that are taught their answers (Carpenter, Grossberg, Markuzon, Reynolds, Rosen 1992).

A Fuzzy ART module makes boxes of inputs; a map field gives each box one answer. Where a box that fits has another
answer than the one that is taught, vigilance rises just above how well it fits (match tracking), and the search goes
on: so exceptions get boxes of their own, however small. Pure.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Row = NDArray[np.float64]


class Rates(NamedTuple):
    """Settings; names are the paper's."""

    rho: float = 0.0
    """Vigilance that each search begins with: 0 makes the largest boxes."""
    alpha: float = 0.001
    """Choice parameter; near 0 the smallest box that changes least is chosen."""
    beta: float = 1.0
    """Learning rate; 1 makes a box grow at once."""
    epsilon: float = 1e-6
    """How far above the match of a wrong box vigilance rises."""


class FuzzyArtmap:
    """Boxes with answers, in order of birth."""

    def __init__(self, inputs: int, rates: Rates) -> None:
        """Know nothing yet; inputs are ``inputs`` numbers in [0, 1]."""
        self._inputs, self._rates = inputs, rates
        self._weights: NDArray[np.float64] = np.zeros((0, 2 * inputs))
        self.answers: list[int] = []
        """The map field: what each box stands for."""

    def teach(self, pattern: Row, answer: int) -> int:
        """Learn that a pattern, shape (inputs,), has an answer; return the number of the box that holds it."""
        coded, rates = complement_coded(pattern), self._rates
        common = np.minimum(coded, self._weights).sum(axis=1)
        match = common / self._inputs
        choice = common / (rates.alpha + self._weights.sum(axis=1))
        vigilance = rates.rho
        for box in _best_first(choice):
            if match[box] < vigilance:
                continue
            if self.answers[box] == answer:
                old = self._weights[box]
                self._weights[box] = rates.beta * np.minimum(coded, old) + (1.0 - rates.beta) * old
                return box
            vigilance = float(match[box]) + rates.epsilon
        self._weights = np.vstack([self._weights, coded])
        self.answers.append(answer)
        return len(self.answers) - 1

    def learn(self, lessons: Sequence[tuple[Row, int]], rounds: int) -> int:
        """Learn an ordered list again and again until all is answered right; return how many rounds that took."""
        for done in range(rounds):
            if done and all(self.answer(pattern) == answer for pattern, answer in lessons):
                return done
            for pattern, answer in lessons:
                self.teach(pattern, answer)
        return rounds

    def answer(self, pattern: Row) -> int:
        """Return the answer of the box that is chosen for a pattern, shape (inputs,). ValueError before any lesson."""
        if not self.answers:
            raise ValueError("Fuzzy ARTMAP: expected to have been taught something, got a question first")
        common = np.minimum(complement_coded(pattern), self._weights).sum(axis=1)
        return self.answers[int((common / (self._rates.alpha + self._weights.sum(axis=1))).argmax())]

    def digest(self) -> str:
        """Return the SHA-256, in hex, of boxes and answers."""
        answers = np.array(self.answers, "<i8").tobytes()
        return hashlib.sha256(self._weights.astype("<f8").tobytes() + answers).hexdigest()


def complement_coded(pattern: Row) -> Row:
    """Return inputs in [0, 1], shape (n,), followed by one minus each: their sum is always n. Raises ValueError."""
    if not ((pattern >= 0.0) & (pattern <= 1.0)).all():
        raise ValueError(f"Fuzzy ARTMAP: expected inputs from 0 to 1, got {pattern.tolist()}")
    return np.concatenate([pattern, 1.0 - pattern])


def _best_first(choice: Row) -> list[int]:
    """Return the boxes in the order of the search; of equals the older first."""
    order: list[int] = np.argsort(-choice, kind="stable").tolist()
    return order
