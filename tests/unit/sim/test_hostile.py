"""100 000 random and worst-case commands at the simulated cell: whatever comes, nothing goes past the guard's limits.

``TREENAIL_TEST_LONG=1`` gives a million of them, in some minutes.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
import pytest
from msgspec.structs import replace

from services.rules.motions import GuardError, OtherRunError, OutOfOrderError
from services.sim.cell import SimulatedCell
from services.sim.pose import Pose, rotation_vector
from services.task.insertion import Insertion
from services.wire.actions import Increment, increments
from services.wire.definition import Definition
from services.wire.definition_file import load, shipped
from services.wire.errors import RefusedError
from services.wire.force_bound import ForceBound
from services.wire.messages import FtPacket, Home, Move, Moved

RUN = "test-s0"
TOTAL = 1_000_000 if os.environ.get("TREENAIL_TEST_LONG") else 100_000
FENCED = "fenced"
"""A cell of its own with a small workspace, high above the hole, where motions cost nothing."""
CASES = (*(name for name in shipped() if not name.startswith("suite-")), FENCED)
COMMANDS = TOTAL // len(CASES)
STUBBORN = 12
"""Refusals of good motions in a row after which the enemy begins anew."""
NAMES = Increment._fields
NOT_NUMBERS = (math.nan, math.inf, -math.inf)


def definition_of(name: str) -> Definition:
    if name != FENCED:
        return load(name)
    plain = load("square-q-softmax")
    limits = replace(plain.limits, workspace_mm=2.0, workspace_deg=1.5)
    return replace(plain, start=replace(plain.start, height_mm=15.0), limits=limits)


@dataclass
class Enemy:
    """Knows the definition, hears every answer, and wants to get the arm beyond a limit."""

    definition: Definition
    seed: int
    seen: Counter[str] = field(default_factory=Counter)
    """What came of the commands."""
    peak_n: float = 0.0
    farthest_mm: float = 0.0
    most_turned_deg: float = 0.0
    deepest_mm: float = 0.0

    def __post_init__(self) -> None:
        self.dice = np.random.default_rng(self.seed)
        self.cell = SimulatedCell(self.definition, RUN, self.seed)
        self.task = Insertion(self.definition, RUN, self.seed)
        self.actions = increments(self.definition.moves)
        self.sizes = np.abs(np.array(self.actions)).max(axis=0)
        self.bound = ForceBound(self.definition)
        self.still_n = self.bound.added_n(Increment())
        self.episode = -1
        self.begin()

    def begin(self) -> None:
        """Home, and choose a way to press."""
        self.episode += 1
        self.home = self.task.home(self.episode, 0)
        self.answered(self.home, self.cell.home(self.home))
        self.style = int(self.dice.integers(5))
        self.goal_mm = float(self.dice.uniform(1.0, 9.8))
        self.bias = self.dice.choice([-1.0, 0.0, 1.0], 6)
        self.stubborn = 0

    def command(self) -> None:
        """Give one command of some kind."""
        kind = float(self.dice.random())
        if self.stubborn >= STUBBORN or self.moved.step >= self.definition.limits.move_limit:
            self.begin()
        elif kind < 0.45:
            self.refused(self.next(self.wild()), GuardError)
        elif kind < 0.60:
            self.refused(self.out_of_order(), OutOfOrderError)
        elif kind < 0.65:
            self.refused(replace(self.next(self.press()), run="another-s0"), OtherRunError)
        elif kind < 0.75:
            self.refused(self.wild_home(), GuardError)
        elif kind < 0.80:
            assert isinstance(self.last, Home) or self.cell.move(self.last) == (self.moved, self.packet)
            self.seen["again"] += 1
        else:
            self.try_to(self.next(self.press()))

    def next(self, increment: Increment) -> Move:
        """Return the motion that would be next."""
        return Move(run=RUN, episode=self.moved.episode, step=self.moved.step + 1, **increment._asdict())

    def out_of_order(self) -> Move:
        """Return a motion that is neither the next one nor the last one again."""
        episode, step = self.moved.episode, self.moved.step
        others = [(episode, step + 2), (episode, step + 2**40), (episode + 1, step + 1), (episode + 1, 1)]
        if step > 1:
            others += [(episode, 1), (episode, step - 1)]
        number, motion = others[int(self.dice.integers(len(others)))]
        return replace(self.next(self.press()), episode=number, step=motion)

    def wild(self) -> Increment:
        """Return an increment with one component beyond its limit, or no number."""
        index = int(self.dice.integers(6))
        values = list(self.actions[int(self.dice.integers(len(self.actions)))])
        limit = float(self.sizes[index])
        beyond = (limit + 1e-6) * float(self.dice.choice([1.0, 1.01, 2.0, 50.0])) * float(self.dice.choice([-1.0, 1.0]))
        values[index] = float(self.dice.choice(NOT_NUMBERS)) if self.dice.random() < 0.2 else beyond
        return Increment(*values)

    def wild_home(self) -> Home:
        """Return a start pose that no episode begins with."""
        start = self.definition.start
        name = str(self.dice.choice(["x_mm", "y_mm", "z_mm", "rx_deg", "ry_deg", "rz_deg"]))
        spread = max(start.spreads)
        far = float(self.dice.choice([1e-3, 1.0, 10.0, 300.0])) * float(self.dice.choice([-1.0, 1.0]))
        middle = -start.height_mm if name == "z_mm" else getattr(start, name)
        return replace(self.home, episode=self.episode + 1, **{name: middle + far + math.copysign(2 * spread, far)})

    def press(self) -> Increment:
        """Return a motion within the limits, as bad as it can be: down, to one side, or any way, in full steps."""
        if self.style == 4 and self.stubborn < STUBBORN / 2 and self.cell.world.flange.z_mm < self.goal_mm:
            return self.inwards()
        force_n = math.hypot(*self.packet.force_n[-1])
        if force_n == 0.0 and self.dice.random() < 0.7:
            return Increment(dz_mm=self.definition.moves.insertion_mm)
        if self.style == 0:
            return self.actions[int(self.dice.integers(len(self.actions)))]
        if self.style == 1:
            return Increment(dz_mm=self.definition.moves.insertion_mm)
        signs = self.dice.uniform(-1.0, 1.0, 6) if self.style == 3 else self.bias
        values = self.sizes * signs * (self.dice.random(6) < 0.7)
        values[2] = abs(values[2])
        added_n = self.bound.added_n(Increment(*values.tolist())) - self.still_n
        most_n = self.bound.largest_n - self.still_n
        return Increment(*(values * min(1.0, most_n / max(added_n, 1e-9))).tolist())

    def inwards(self) -> Increment:
        """Return an action that brings the peg straight into the hole, by its true pose, to jam it there."""
        flange = self.cell.world.flange
        turned = np.degrees(rotation_vector(flange.orientation))
        off = np.array([-flange.x_mm, -flange.y_mm, 0.0, *-turned])
        wanted = [action for action in self.actions if float(np.dot(action, off)) > 0.6 * float(np.dot(action, action))]
        down = Increment(dz_mm=self.definition.moves.insertion_mm)
        return wanted[int(self.dice.integers(len(wanted)))] if wanted else down

    def refused(self, asked: Move | Home, kind: type[RefusedError]) -> None:
        """Check that a command is refused for its reason, in one line, and that nothing moved."""
        flange = self.cell.world.flange
        with pytest.raises(kind) as caught:
            self.cell.home(asked) if isinstance(asked, Home) else self.cell.move(asked)
        assert "\n" not in str(caught.value)
        assert str(caught.value).startswith({GuardError: "guard: ", OutOfOrderError: "move: "}.get(kind, "robot: "))
        assert self.cell.world.flange == flange
        self.seen[kind.__name__] += 1

    def try_to(self, asked: Move) -> None:
        """Make a motion if the guard lets it."""
        flange = self.cell.world.flange
        try:
            answer = self.cell.move(asked)
        except GuardError as error:
            self.stubborn += 1
            self.seen[" ".join(str(error).split()[:2])] += 1
            assert self.cell.world.flange == flange
            return
        self.stubborn = 0
        self.answered(asked, answer)

    def answered(self, asked: Move | Home, answer: tuple[Moved, FtPacket]) -> None:
        """Check where a motion led, with arithmetic that is not the guard's."""
        self.last, (self.moved, self.packet) = asked, answer
        self.peak_n = max(self.peak_n, math.hypot(*self.packet.force_n[-1]))
        if isinstance(asked, Home):
            self.pose, self.depth_mm = Pose(0.0, 0.0, 0.0), asked.z_mm
            return
        self.seen["made"] += 1
        made = Increment(*(getattr(self.moved, name) for name in NAMES))
        assert made == tuple(getattr(asked, name) for name in NAMES)
        assert (np.abs(made) <= self.sizes + 1e-9).all()
        assert made.dz_mm >= -1e-9
        self.pose, self.depth_mm = self.pose.moved(made), self.depth_mm + made.dz_mm
        self.farthest_mm = max(self.farthest_mm, math.hypot(*self.pose.position))
        turned_deg = math.degrees(math.hypot(*rotation_vector(self.pose.orientation)))
        self.most_turned_deg = max(self.most_turned_deg, turned_deg)
        self.deepest_mm = max(self.deepest_mm, self.depth_mm)


@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", CASES)
def test_nothing_goes_past_the_limits(name: str) -> None:
    definition = definition_of(name)
    enemy = Enemy(definition, seed=CASES.index(name))
    for _ in range(COMMANDS):
        enemy.command()
    limits, moves = definition.limits, definition.moves
    assert enemy.peak_n < limits.hard_force_n
    assert enemy.deepest_mm <= limits.success_fraction * definition.parts.peg_height_mm + moves.insertion_mm + 1e-6
    assert (
        enemy.farthest_mm
        <= (limits.workspace_mm or limits.move_limit * max(moves.lateral_mm, moves.insertion_mm)) + 1e-6
    )
    assert enemy.most_turned_deg <= (limits.workspace_deg or 180.0) + 1e-6
    # An enemy that is let do nothing, or that nobody has to stop, proves nothing.
    assert enemy.seen["made"] > COMMANDS / 10
    assert min(enemy.seen[kind] for kind in ("GuardError", "OutOfOrderError", "OtherRunError", "again")) > 100
    if name == FENCED:
        assert enemy.farthest_mm > 1.9
        assert enemy.most_turned_deg > 1.4
        assert enemy.seen["guard: workspace:"] > 100
    else:
        assert enemy.peak_n >= limits.collision_force_n
        assert enemy.seen["guard: force:"] > 20
