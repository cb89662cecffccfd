"""What is done to a cell, and when: a plan that is a function of its seed and of what was asked for, and nothing else.

Moments are counted in decisions, not in seconds, so that a plan meets the run at the same places on any machine.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from services.wire.errors import TreenailError

SERVICES = ("router", "store", "task", "sim", "classifier", "agent", "viewer")
KINDS = {
    "kill": "SIGKILL of one service",
    "several": "SIGKILL of several at once",
    "again": "SIGKILL of one, and of another while the first comes back",
    "freeze": "SIGSTOP of one for 5 s",
    "lose": "messages lost",
    "delay": "messages delayed by up to 0.5 s",
    "repeat": "messages repeated, up to 1 s later",
    "reorder": "messages overtaken by the next ones",
    "cut": "a link silent for 3 s",
    "full-disk": "no room for the store to write",
    "clock": "the wall clock of all jumps",
    "skew": "the wall clock of one service jumps",
}
KILLING = ("kill", "several", "again")
LINK = ("lose", "delay", "repeat", "reorder", "cut")
"""Kinds that need a service to stand behind a tap."""
CLOCK = ("clock", "skew")
FAR = ("agent", "classifier", "sim")
"""Services that stand behind the tap in turn."""
LASTS_S = {"freeze": 5.0, "cut": 3.0, "full-disk": 2.0, **dict.fromkeys(("lose", "delay", "repeat", "reorder"), 2.0)}
MOST_AT_ONCE = 40
"""Disturbances that are planned for one run."""
LATEST = 100
"""Decisions that are waited for at most before the next disturbance."""
JUMPS_S = (2.0, 60.0, 3600.0)


@dataclass(frozen=True)
class Disturbance:
    """One thing that is done to a cell."""

    kind: str
    victims: tuple[str, ...]
    """Services that it is done to; empty when it is done to the tap, or to all."""
    after: int
    """Decisions, since the cell last went on learning, after which it begins."""
    lasts_s: float = 0.0
    strength: float = 0.0
    """Part of the messages that it hits, or a clock's jump [s]."""

    @property
    def killed(self) -> tuple[str, ...]:
        """Return the services whose process it kills."""
        return self.victims if self.kind in KILLING else ()


@dataclass(frozen=True)
class Section:
    """What is done to cells of one shape, run after run until all is done."""

    far: str | None
    """Service that stands behind the tap; None for a cell as ``treenail up`` has it."""
    disturbances: tuple[Disturbance, ...]


@dataclass(frozen=True)
class Plan:
    """A whole campaign."""

    seed: int
    sections: tuple[Section, ...]

    @property
    def disturbances(self) -> tuple[Disturbance, ...]:
        """Return all of them in order."""
        return tuple(disturbance for section in self.sections for disturbance in section.disturbances)

    @property
    def kills(self) -> int:
        """Return how many processes are killed."""
        return sum(len(disturbance.killed) for disturbance in self.disturbances)


def make(
    seed: int, kills: int, others: int, kinds: Sequence[str] = tuple(KINDS), services: Sequence[str] = SERVICES
) -> Plan:
    """Return the plan with this seed: ``kills`` kills, and every other kind that is named ``others`` times.

    Of the kills, a fifth come several at once and a tenth while the cell recovers from another one, if these kinds are
    named; without single kills there may be one kill more than asked for. Raises TreenailError for what is unknown,
    and when that is nothing at all.
    """
    _check("--kinds", kinds, tuple(KINDS))
    _check("--services", services, SERVICES)
    if kills < 0 or others < 0:
        raise TreenailError(f"--kills and --others: expected 0 or more, got {kills} and {others}")
    draw = random.Random(seed)
    disturbances = list(_kills(draw, kills, kinds, services)) if set(kinds) & set(KILLING) else []
    for kind in kinds:
        if kind not in KILLING:
            disturbances += [_other(draw, kind, services) for _ in range(others)]
    if not disturbances:
        raise TreenailError("--kills and --others: expected something to do, got 0 of each that is named")
    return Plan(seed, tuple(_sections(draw, disturbances)))


def _check(option: str, named: Sequence[str], names: Sequence[str]) -> None:
    wrong = [name for name in named if name not in names]
    if wrong or not named or len(set(named)) != len(named):
        raise TreenailError(
            f"{option}: expected some of {', '.join(names)}, each once, got {', '.join(named) or 'none'}"
        )


def _kills(draw: random.Random, count: int, kinds: Sequence[str], services: Sequence[str]) -> Iterator[Disturbance]:
    left = count
    budget = {"several": count // 5, "again": count // 10}
    for kind in ("several", "again"):
        while kind in kinds and len(services) > 1 and (budget[kind] >= 2 or ("kill" not in kinds and left > 0)):
            most = max(2, min(budget[kind], len(services))) if kind == "several" else 2
            victims = tuple(draw.sample(services, draw.randint(2, most)))
            budget[kind] -= len(victims)
            left -= len(victims)
            lasts_s = draw.uniform(0.05, 1.5) if kind == "again" else 0.0
            yield Disturbance(kind, victims, _after(draw), lasts_s)
    order = draw.sample(services, len(services))
    for number in range(left):  # in turn, so that nobody is spared
        yield Disturbance("kill", (order[number % len(order)],), _after(draw))


def _other(draw: random.Random, kind: str, services: Sequence[str]) -> Disturbance:
    victims: tuple[str, ...] = ()
    strength = 0.0
    if kind in ("freeze", "skew"):
        victims = (draw.choice(services),)
    if kind in CLOCK:
        strength = draw.choice((-1.0, 1.0)) * draw.choice(JUMPS_S)
    elif kind == "lose":
        strength = draw.uniform(0.05, 0.2)  # each costs up to a second
    elif kind in LINK:
        strength = draw.uniform(0.1, 0.5)
    return Disturbance(kind, victims, _after(draw), LASTS_S.get(kind, 0.0), strength)


def _after(draw: random.Random) -> int:
    return draw.randint(1, LATEST)


def _sections(draw: random.Random, disturbances: list[Disturbance]) -> Iterator[Section]:
    """Deal the disturbances out to runs: those of the link to runs with a tap, the others to all alike."""
    link = [disturbance for disturbance in disturbances if disturbance.kind in LINK]
    rest = [disturbance for disturbance in disturbances if disturbance.kind not in LINK]
    count = max(math.ceil(len(disturbances) / MOST_AT_ONCE), (1 if link else 0) + (1 if rest else 0))
    tapped = 0 if not link else count if not rest else count // 2
    piles: list[list[Disturbance]] = [[] for _ in range(count)]
    with_tap = piles[count - tapped :]
    for number, disturbance in enumerate(link):
        with_tap[number % tapped].append(disturbance)
    draw.shuffle(rest)
    for disturbance in rest:
        min(piles, key=len).append(disturbance)
    far = (*draw.sample(FAR[:2], 2), FAR[2])  # most messages pass before an agent or a classifier
    for number, pile in enumerate(piles):
        draw.shuffle(pile)
        behind = number - (count - tapped)
        yield Section(far[behind % len(far)] if behind >= 0 else None, tuple(pile))
