"""Hand-written controllers behind the same task as a learner: what an engineer would try first. Pure.

They feel what a learner feels and choose from the same moves; none knows the pose of the peg.
"""

from __future__ import annotations

from itertools import cycle
from typing import NamedTuple, Protocol

from services.wire.actions import ACTION_NAMES, INSERT, Increment
from services.wire.definition import Definition
from services.wire.messages import Observation
from services.wire.randomness import Role, generator

RULE, TIP_RULE, SPIRAL, RANDOM, PUSH = "rule", "rule-tip", "spiral", "random", "rcc"
RULES = (RULE, TIP_RULE)
"""What a learner is held against: two ways to write the same rule, of which now one, now the other is better."""
BASELINES = {
    RULE: "a hand-written compliance rule: give way to force and torque, else step in +Z",
    TIP_RULE: "the same rule with the torque referred to the peg's tip",
    SPIRAL: "the rule with a search in a spiral where it is pressed on a flat face",
    RANDOM: "any move, each as likely",
}

ACTION = {name: index for index, name in enumerate(ACTION_NAMES)}

TURN_N_PER_NM = 4.0
"""How many newtons aside one newton metre of tilt is worth to the rule."""
TWIST_N_PER_NM = 20.0
"""The same for a newton metre about the peg's axis, where levers are shorter."""
SMALL_N = 0.3
"""What is felt aside below this is not answered: the rule steps in the direction of insertion."""
PRESSED_N = 1.0
"""Pressed less than this, every third decision of the rule is a step in the direction of insertion all the same."""


class Choice(NamedTuple):
    """What a controller decides."""

    action: int
    """Index of the move in the definition's list."""
    state: int = 0
    """Contact state that it was taken for; 0 for a controller that knows none."""
    increment: Increment | None = None
    """The move itself, within ``moves.continuous``, where it is no listed one; ``action`` is then what it counts as."""


class Controller(Protocol):
    """Decides about moves in contact."""

    def begin(self) -> None:
        """Begin an episode: whatever was remembered of the last one is forgotten."""

    def decide(self, felt: Observation) -> Choice:
        """Return what to do about what is felt: force [N] and torque [N m], shape (3,) each, in the tool frame."""


class ComplianceRule:
    """Move along the lateral force, turn along the torque, else step in +Z.

    The torque refers to a point as far behind the sensor as the tip is ahead of it: a force aside then counts twice as
    a torque, so that the rule turns early. ``TipRule`` is the same with the torque referred to the tip itself.
    """

    def __init__(self, definition: Definition) -> None:
        self._lever_m = definition.wrist.sensor_height_mm * 1e-3
        self._actions = definition.moves.actions
        self._decisions = 0

    def begin(self) -> None:
        """Begin an episode."""
        self._decisions = 0

    def decide(self, felt: Observation) -> Choice:
        """Return the move that gives way most."""
        self._decisions += 1
        value, action = max(self._ways(felt))
        lightly = -felt.force_n[2] < PRESSED_N and self._decisions % 3 == 0
        return Choice(INSERT if value < SMALL_N or lightly else action)

    def _ways(self, felt: Observation) -> list[tuple[float, int]]:
        """Return how much each move would give way [N], and its action."""
        fx, fy, _ = felt.force_n
        tx, ty, tz = felt.torque_nm
        about_x = TURN_N_PER_NM * (tx - self._lever_m * fy)
        about_y = TURN_N_PER_NM * (ty + self._lever_m * fx)
        about_z = TWIST_N_PER_NM * tz
        pairs = ((fx, "X"), (fy, "Y"), (about_x, "RX"), (about_y, "RY"), (about_z, "RZ"))
        both = [
            (sign * value, ACTION[f"{name}{axis}"]) for value, axis in pairs for sign, name in ((1, "+"), (-1, "-"))
        ]
        return [(value, action) for value, action in both if action < self._actions]


class TipRule(ComplianceRule):
    """The compliance rule with the torque referred to the peg's tip: what the contact itself turns with.

    It moves aside first and seldom turns: less force where the clearance forgives a tilt, more where it does not.
    """

    def __init__(self, definition: Definition) -> None:
        super().__init__(definition)
        self._lever_m = -self._lever_m


class SpiralRule:
    """The compliance rule with a search: pressed on a flat face, it goes round in a widening square spiral.

    It is what is done where there is no chamfer to feel: the way is fixed, goes on after each touch of the rule, and
    begins anew with each episode.
    """

    def __init__(self, definition: Definition) -> None:
        self._rule = ComplianceRule(definition)
        self._turn = 0

    def begin(self) -> None:
        """Begin an episode."""
        self._rule.begin()
        self._turn = 0

    def decide(self, felt: Observation) -> Choice:
        """Return the next move of the spiral where only a push from below is felt, else what the rule says."""
        choice = self._rule.decide(felt)
        if choice.action != INSERT or -felt.force_n[2] < PRESSED_N:
            return choice
        self._turn += 1
        return Choice(_spiral(self._turn))


class Push:
    """No controller at all: steps of +Z whatever is felt, for a wrist that gives way by itself."""

    def begin(self) -> None:
        """Begin an episode."""

    def decide(self, felt: Observation) -> Choice:
        """Return +Z."""
        return Choice(INSERT)


class RandomMoves:
    """Any move, each as likely as the others."""

    def __init__(self, definition: Definition, seed: int) -> None:
        self._actions = definition.moves.actions
        self._seed = seed

    def begin(self) -> None:
        """Begin an episode."""

    def decide(self, felt: Observation) -> Choice:
        """Return a move that is drawn for this episode and step."""
        return Choice(int(generator(self._seed, Role.POLICY, felt.episode, felt.step).integers(self._actions)))


def _spiral(turn: int) -> int:
    """Return the ``turn``-th move, from 1, of a square spiral: +X, +Y, 2 -X, 2 -Y, 3 +X, and so on."""
    done = 0
    for side, name in enumerate(cycle(("+X", "+Y", "-X", "-Y"))):
        done += side // 2 + 1
        if turn <= done:
            return ACTION[name]
    raise AssertionError("a spiral has no end")
