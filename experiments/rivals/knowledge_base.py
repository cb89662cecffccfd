"""Lopez-Juarez's controller: Fuzzy ARTMAP over a primitive knowledge base (thesis 2.2).

The knowledge base is an ordered list of force/torque patterns with the move that answers each, written down before
anything was ever touched: a push along an axis is given way to, a torque about an axis is turned along, and a push from
below alone is pressed on against. All patterns are loads by direction; nothing is learnt from the task.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from experiments.evaluate.controllers import ACTION, Choice
from experiments.rivals.artmap import FuzzyArtmap, Rates, Row
from experiments.rivals.tip import tip_wrench
from services.wire.actions import INSERT, action_names
from services.wire.definition import Definition
from services.wire.messages import Observation

TORQUE_PER_M = 20.0
"""How many newtons a newton metre about the tip counts as."""
PUSHES = (0.5, 1.0, 2.0, 4.0)
"""The push from below, as a multiple of the load aside, that each load is written down with."""
AXES = ("X", "Y", "Z", "RX", "RY", "RZ")
USUAL = Rates()
ROUNDS = 20
"""Most times that the list is gone through."""


class Primitive(NamedTuple):
    """One entry: a load, shape (6,), in N with torques as ``TORQUE_PER_M`` has them, and the move that answers it."""

    load: Row
    action: int


def primitives(definition: Definition) -> Iterator[Primitive]:
    """Yield the knowledge base for the moves of a task, in order."""
    from_below = np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0])
    yield Primitive(from_below, INSERT)
    for push in PUSHES:
        for name in action_names(definition.moves):
            axis = AXES.index(name[1:])
            if name[1:] != "Z":
                load = push * from_below
                load[axis] = 1.0 if name[0] == "+" else -1.0
                yield Primitive(load, ACTION[name])


class ArtmapController:
    """Makes the move that the network answers to what is felt, its torque referred to the tip."""

    def __init__(self, definition: Definition, rates: Rates = USUAL) -> None:
        """Teach the network the knowledge base."""
        self._lever_m = definition.wrist.sensor_height_mm * 1e-3
        self.network = FuzzyArtmap(len(AXES), rates)
        self.network.learn([(_coded(load), action) for load, action in primitives(definition)], ROUNDS)

    def begin(self) -> None:
        """Begin an episode; there is nothing to forget."""

    def decide(self, felt: Observation) -> Choice:
        """Return the move that answers a load."""
        load = tip_wrench(felt, self._lever_m, TORQUE_PER_M)
        return Choice(self.network.answer(_coded(load)))


def _coded(load: Row) -> Row:
    """Return the direction of a load, shape (6,), as inputs from 0 to 1."""
    coded: Row = np.clip((1.0 + load / np.sqrt((load * load).sum())) / 2.0, 0.0, 1.0)
    return coded
