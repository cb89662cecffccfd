"""Asada's and Howarth's controllers: multilayer perceptrons, taught the move for what is felt (thesis 2.2).

Asada's sees all six components and is taught by an operator who sees the task. Howarth's sees three forces and the
torque about the peg's axis, moves along the axes and about the peg, never tilts, and is taught pairs of input and
output that somebody established: here by the hand-written rule. Both are trained by back-propagation before the first
insertion, and learn no more. The direction of insertion, Howarth's fifth input, is always +Z in the tool frame.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.evaluate.controllers import Choice, TipRule
from experiments.rivals.teachers import Operator, Shown, by_rule, show
from experiments.rivals.tip import tip_wrench
from services.wire.actions import action_names
from services.wire.definition import Definition
from services.wire.errors import TreenailError
from services.wire.messages import Observation

UNIT_N, TORQUE_PER_M = 1.0, 20.0
"""What is felt is brought to about 1: by a force, and by what a newton metre about the tip counts as."""
FLAT = ("X", "Y", "Z", "RZ")
"""The axes of an arm of SCARA's kind, such as Howarth's."""
FOUR = (0, 1, 2, 5)
"""What Howarth's network sees of the six components."""


class Lessons(NamedTuple):
    """How much a network is taught."""

    insertions: int = 40
    hidden: tuple[int, ...] = (24, 24)
    rounds: int = 400
    """Most times that back-propagation goes through all lessons."""


USUAL = Lessons()


class NetworkController:
    """Makes the move that a trained network thinks likeliest to be the teacher's."""

    def __init__(
        self, definition: Definition, inputs: Sequence[int], lessons: Sequence[Shown], how: Lessons, seed: int
    ):
        """Train on lessons. Raises TreenailError without the library, or with lessons that know one move only."""
        self._lever_m = definition.wrist.sensor_height_mm * 1e-3
        self._inputs = list(inputs)
        moves = sorted({lesson.action for lesson in lessons})
        if len(moves) < 2:
            raise TreenailError(f"lessons: expected several moves, got {moves} in {len(lessons)} lessons")
        rows = np.array([self._input(lesson.felt) for lesson in lessons])
        network = _perceptron(how, seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that it could go on longer
            network.fit(rows, [lesson.action for lesson in lessons])
        self._layers: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = list(
            zip(network.coefs_, network.intercepts_, strict=True)
        )
        self._moves: list[int] = network.classes_.tolist()

    def begin(self) -> None:
        """Begin an episode; there is nothing to forget."""

    def decide(self, felt: Observation) -> Choice:
        """Return the likeliest move; of equals the first."""
        values = self._input(felt)
        for depth, (weights, offset) in enumerate(self._layers):
            values = (values[:, None] * weights).sum(axis=0) + offset
            if depth < len(self._layers) - 1:
                values = np.tanh(values)
        # Of two moves the library keeps one output: above 0 it is the second.
        best = int(values.argmax()) if len(values) > 1 else int(values[0] > 0.0)
        return Choice(self._moves[best])

    def digest(self) -> str:
        """Return the SHA-256, in hex, of all weights."""
        return hashlib.sha256(
            b"".join(part.astype("<f8").tobytes() for layer in self._layers for part in layer)
        ).hexdigest()

    def _input(self, felt: Observation) -> NDArray[np.float64]:
        """Return what the network sees, shape (inputs,), each from -1 to 1."""
        load = tip_wrench(felt, self._lever_m, TORQUE_PER_M)[self._inputs]
        return load / (UNIT_N + np.abs(load))


def asada(definition: Definition, seed: int, how: Lessons = USUAL) -> NetworkController:
    """Return Asada's controller, taught by an operator who sees the pose."""
    lessons = show(definition, Operator(definition), seed, how.insertions)
    return NetworkController(definition, range(6), lessons, how, seed)


def howarth(definition: Definition, seed: int, how: Lessons = USUAL) -> NetworkController:
    """Return Howarth's controller, taught pairs that a rule establishes, as far as they are within its four axes."""
    rule = TipRule(definition)
    shown = show(definition, by_rule(rule), seed, how.insertions, rule.begin)
    names = action_names(definition.moves)
    lessons = [lesson for lesson in shown if names[lesson.action][1:] in FLAT]
    return NetworkController(definition, FOUR, lessons, how, seed)


def _perceptron(how: Lessons, seed: int) -> Any:
    """Return a network that has learnt nothing. Raises TreenailError without the library."""
    try:
        from sklearn.neural_network import MLPClassifier
    except ImportError as error:
        raise TreenailError(
            f'expected the library scikit-learn (pip install "treenail[rivals]"), got: {error}'
        ) from error
    return MLPClassifier(how.hidden, activation="tanh", alpha=1e-4, max_iter=how.rounds, random_state=seed % 2**32)
