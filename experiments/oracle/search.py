"""The best insertions that a search with full knowledge finds in the deterministic simulator.

Two stages. A beam search decides move by move, for several prices of force at once. It knows the pose, judges what is
left to do by the distance to the free corridor, and goes on from remembered poses of flange and peg. That forgets
which way friction points, so its forces are good to some percent. Every insertion that it finds is therefore made
again from home, through the task and the cell that a learner meets, and only these numbers count. From there a local
search drops, moves, swaps, replaces and adds moves, each attempt again from home.

Nothing here proves an optimum: what is found is a lower bound of what is possible. Same definition and effort, same
result, bit for bit.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from experiments.lab.rehearsal import Attempt, Rehearsal
from services.rules.hole import standing
from services.sim.geometry import Geometry, clearance, geometry_of
from services.sim.pose import Pose, axis, from_angles
from services.sim.world import Reading, World
from services.task.rewards import reward_of_move
from services.wire.actions import INSERT, increments
from services.wire.definition import Definition, InsertionReward
from services.wire.felt_noise import contact_force_n

Advanced = Callable[[str, int, int], None]
"""Hears how the search gets on: stage, how much is done, of about how much."""

_FAR = Pose(0.0, 0.0, -1000.0)
_SAME_MM, _SAME_TURN = 0.05, 0.0005
"""Poses this close count as one: a quarter of the usual steps (a quaternion's component is half an angle)."""
_FINISHERS = 6
"""How many insertions of each aim leave the beam search."""


class Effort(NamedTuple):
    """How much is tried."""

    beam: int = 8
    """Positions kept for each aim after each move."""
    attempts: int = 700
    """Most insertions made from home by the local search."""


class Aim(NamedTuple):
    """One idea of what is good: a return is worth 1, a newton felt after one move costs ``price``."""

    price: float
    lean_n: float
    """Force that may stand on the wrist at the end: walls nearer than this bends the wrist need no move."""


AIMS = (
    Aim(1e-4, 8.0),
    Aim(1e-3, 5.0),
    Aim(0.004, 3.0),
    Aim(0.01, 1.5),
    Aim(0.03, 0.7),
    Aim(0.1, 0.3),
    Aim(0.3, 0.0),
    Aim(1.0, 0.0),
)


class Snapshot(NamedTuple):
    """Where a world stands; what the contacts remember of friction is not in it."""

    flange: Pose
    peg: Pose
    at_flange: bool


class Explorer(World):
    """A world that can be put back to where it stood."""

    def snapshot(self) -> Snapshot:
        """Return where flange and peg are."""
        return Snapshot(self.flange, self.peg, self._at_flange)

    def resume(self, snapshot: Snapshot) -> None:
        """Put flange and peg back, at rest, with no memory of what was done since, nor of friction before."""
        self._flange, peg, self._at_flange = snapshot
        if not self._at_flange:
            self._place(_FAR)
            self._system.step()
            self._place(peg)
            self._drive.set_drive_target(self._anchor(snapshot.flange))


@dataclass(frozen=True, eq=False)
class _Node:
    """A position after some moves, and what it took to get there."""

    before: _Node | None
    motion: int
    snapshot: Snapshot
    force_n: float
    depth_mm: float
    cost: float
    """Rewards so far, with their sign changed."""
    force_sum_n: float
    without_progress: int
    to_go: tuple[float, ...]
    """Rewards that the moves still needed will cost, for each aim."""

    def score(self, aim: int) -> float:
        return self.cost + self.to_go[aim] + AIMS[aim].price * self.force_sum_n

    def motions(self) -> tuple[int, ...]:
        backwards: list[int] = []
        node = self
        while node.before is not None:
            backwards.append(node.motion)
            node = node.before
        return tuple(reversed(backwards))


class _Beam:
    """The beam search."""

    def __init__(self, definition: Definition, width: int) -> None:
        self._definition = definition
        self._width = width
        self._world = Explorer(definition)
        self._increments = increments(definition.moves)
        self._contact_n = contact_force_n(definition)
        self._success_mm = definition.limits.success_fraction * definition.parts.peg_height_mm
        self._finished: list[list[_Node]] = [[] for _ in AIMS]

    def search(self, advanced: Advanced) -> list[tuple[int, ...]]:
        """Return the motions of the insertions found, without repetition."""
        limits = self._definition.limits
        beam = [self._home()]
        likely = round(
            1.5 * (self._success_mm + self._definition.start.height_mm) / self._definition.moves.insertion_mm
        )
        for move in range(1, limits.move_limit + 1):
            children = [child for node in beam for child in self._children(node)]
            for node in children:
                if node.depth_mm >= self._success_mm:
                    self._finish(node)
            beam = self._kept([node for node in children if node.depth_mm < self._success_mm])
            advanced("beam search", move, likely)
            if not beam:
                break
        plans = (node.motions() for finished in self._finished for node in finished)
        return list(dict.fromkeys(plans))

    def _home(self) -> _Node:
        start = self._definition.start
        pose = Pose.from_tilt(start.x_mm, start.y_mm, -start.height_mm, start.rx_deg, start.ry_deg, start.rz_deg)
        stands = standing(self._definition.hole, 0, 0)
        force_n = _magnitude(self._world.home(pose if stands is None else Pose(*stands.in_hole(pose))))
        none = (0.0,) * len(AIMS)
        return _Node(None, INSERT, self._world.snapshot(), force_n, -start.height_mm, 0.0, 0.0, 0, none)

    def _children(self, node: _Node) -> Iterator[_Node]:
        """What can come after a position, as far as it does not end the episode badly."""
        contact = node.force_n >= self._contact_n
        for action in range(len(self._increments)) if contact else (INSERT,):
            if contact and node.motion == _opposite(action):
                continue
            idle = node.without_progress + 1 if contact and action != INSERT else 0
            if 0 < self._definition.limits.no_progress_moves < idle:
                continue
            child = self._child(node, action, contact, idle)
            if child is not None:
                yield child

    def _child(self, node: _Node, action: int, contact: bool, idle: int) -> _Node | None:
        limits = self._definition.limits
        self._world.resume(node.snapshot)
        force_n = _magnitude(self._world.move(self._increments[action]))
        depth_mm = node.depth_mm + self._increments[action].dz_mm
        if force_n >= limits.collision_force_n:
            return None
        if depth_mm < self._success_mm and force_n > limits.hard_force_n:
            return None
        cost = node.cost
        if contact:
            cost -= reward_of_move(self._definition.reward, self._increments[action].dz_mm, node.force_n, force_n)
        snapshot = self._world.snapshot()
        to_go = (0.0,) * len(AIMS) if depth_mm >= self._success_mm else self._to_go(snapshot.flange)
        total = node.force_sum_n + force_n
        idle = idle if force_n >= self._contact_n else 0
        return _Node(node, action, snapshot, force_n, depth_mm, cost, total, idle, to_go)

    def _to_go(self, flange: Pose) -> tuple[float, ...]:
        reward = self._definition.reward
        price = -(reward.step if isinstance(reward, InsertionReward) else reward.otherwise)
        stiffness = self._definition.wrist.stiffness_n_per_mm
        ways = corridor_moves(geometry_of(self._definition.parts), flange, self._success_mm, self._definition)
        least = []
        for aim in AIMS:
            lean_mm = aim.lean_n / stiffness
            least.append(price * min(turns + max(0.0, overlap - lean_mm) * per_mm for turns, overlap, per_mm in ways))
        return tuple(least)

    def _finish(self, node: _Node) -> None:
        for aim, finished in enumerate(self._finished):
            finished.append(node)
            finished.sort(key=lambda done: done.score(aim))
            del finished[_FINISHERS:]

    def _kept(self, nodes: list[_Node]) -> list[_Node]:
        """The best different positions of each aim that can still be better than what is finished."""
        kept: dict[int, _Node] = {}
        for aim in range(len(AIMS)):
            finished = self._finished[aim]
            bound = finished[0].score(aim) if finished else math.inf
            seen: set[tuple[int, ...]] = set()
            for node in sorted(nodes, key=lambda node: node.score(aim)):
                if len(seen) == self._width or node.score(aim) >= bound:
                    break
                place = _place(node.snapshot.flange)
                if place not in seen:
                    seen.add(place)
                    kept[id(node)] = node
        return list(kept.values())


def corridor_moves(
    geometry: Geometry, flange: Pose, depth_mm: float, definition: Definition
) -> list[tuple[float, float, float]]:
    """What separates a pose from one that can go straight down to a depth, for several parts of its tilt taken away.

    Each entry: rotations needed, overlap left with the walls [mm], lateral moves per mm of overlap. Not rounded to
    whole moves, and the same for poses that differ in depth only, so that positions can be compared fairly.
    """
    lean_x, lean_y, upright = axis(flange.orientation)
    tilt_x, tilt_y = math.degrees(math.atan2(-lean_y, upright)), math.degrees(math.atan2(lean_x, upright))
    spin = math.degrees(2.0 * math.atan2(flange.qz, flange.qw)) if definition.parts.shape != "round" else 0.0
    total = (abs(tilt_x) + abs(tilt_y) + abs(spin)) / definition.moves.rotation_deg
    ways = []
    for part in (0.0, 0.25, 0.5, 0.75, 1.0) if definition.moves.actions > 5 else (0.0,):
        keep = 1.0 - part
        orientation = from_angles(keep * tilt_x, keep * tilt_y, keep * spin)
        end = Pose(flange.x_mm, flange.y_mm, depth_mm, *orientation)
        middle = end.point((geometry.chamfer - depth_mm) / 2.0)
        size = math.hypot(middle[0], middle[1])
        per_mm = (abs(middle[0]) + abs(middle[1])) / size if size > 0.0 else 1.0
        ways.append((part * total, max(0.0, -clearance(geometry, end)), per_mm / definition.moves.lateral_mm))
    return ways


@dataclass
class Front:
    """Insertions of which none has both a return and a mean force at least as good as another's."""

    attempts: list[Attempt] = field(default_factory=list)
    """Best return first, so least force last."""

    def add(self, attempt: Attempt | None) -> bool:
        """Take an attempt if it is an insertion that belongs here; drop what it makes superfluous."""
        if attempt is None or attempt.summary.outcome != "inserted":
            return False
        if any(_covers(other, attempt) for other in self.attempts):
            return False
        self.attempts = [other for other in self.attempts if not _covers(attempt, other)] + [attempt]
        self.attempts.sort(key=lambda other: -other.summary.episode_return)
        return True


def _covers(attempt: Attempt, other: Attempt) -> bool:
    better_return = attempt.summary.episode_return >= other.summary.episode_return
    return better_return and attempt.summary.mean_force_n <= other.summary.mean_force_n


def search(definition: Definition, effort: Effort, advanced: Advanced) -> list[Attempt]:
    """Return the front of the insertions found, best return first; empty when none was found.

    Raises:
        TreenailError: see ``Rehearsal``.
    """
    rehearsal, front = Rehearsal(definition), Front()
    for plan in _Beam(definition, effort.beam).search(advanced):
        front.add(rehearsal.follow(plan))
    tried: dict[tuple[int, ...], Iterator[tuple[int, ...]]] = {}
    for number in range(1, effort.attempts + 1):
        variant = _next_plan(front, tried, number, definition.moves.actions)
        if variant is None:
            break
        front.add(rehearsal.follow(variant))
        advanced("local search", number, effort.attempts)
    return front.attempts


def _next_plan(
    front: Front, tried: dict[tuple[int, ...], Iterator[tuple[int, ...]]], number: int, actions: int
) -> tuple[int, ...] | None:
    """The next variant to try, of each insertion of the front in turn; None when all were tried."""
    count = len(front.attempts)
    for offset in range(count):
        attempt = front.attempts[(number + offset) % count]
        variant = next(tried.setdefault(attempt.motions, variants(attempt, actions)), None)
        if variant is not None:
            return variant
    return None


def variants(attempt: Attempt, actions: int) -> Iterator[tuple[int, ...]]:
    """Plans one change away from an attempt: first each move left out, then the other changes in a shuffled order."""
    motions = attempt.motions
    decided = [index for index, decided in enumerate(attempt.decided) if decided]
    own = [index for index in decided if motions[index] != INSERT]
    for index in own:
        yield motions[:index] + motions[index + 1 :]
    changes: list[tuple[int, ...]] = []
    for index in own:
        without = motions[:index] + motions[index + 1 :]
        changes += [(*without[:to], motions[index], *without[to:]) for to in _around(index, len(without))]
        changes += [(*motions[:index], a, *motions[index + 1 :]) for a in range(actions) if a != motions[index]]
    for index in decided:
        changes += [(*motions[:index], action, *motions[index:]) for action in range(actions) if action != INSERT]
    changes = [plan for plan in dict.fromkeys(changes) if plan != motions]
    random.Random(len(motions)).shuffle(changes)
    yield from changes


def _around(index: int, most: int) -> list[int]:
    return [to for distance in (1, 2, 4, 8) for to in (index - distance, index + distance) if 0 <= to <= most]


def _opposite(action: int) -> int | None:
    """The action that takes one back; +Z has none."""
    if action == INSERT:
        return None
    first = action if action < INSERT else action - 1
    return first ^ 1 if action < INSERT else (first ^ 1) + 1


def _magnitude(reading: Reading) -> float:
    return math.hypot(*reading.force_n)


def _place(pose: Pose) -> tuple[int, ...]:
    return tuple(round(value / (_SAME_MM if index < 3 else _SAME_TURN)) for index, value in enumerate(pose))
