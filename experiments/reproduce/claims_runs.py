"""The runs behind the claims of 5.3 and of 4.2.2: who learns, who does not, where, and with which skill."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from msgspec.structs import replace

from experiments.evaluate.controllers import RULES
from experiments.evaluate.frozen import FrozenSkill
from experiments.evaluate.run import Method
from experiments.evaluate.trial import trial
from experiments.lab.in_process import InProcessRun
from experiments.reproduce.insertion_runs import LETTERS
from services.rules.skill import NamedSkill
from services.rules.skill_moves import carried
from services.wire.definition import Definition
from services.wire.definition_file import definition_sha256, load
from services.wire.definition_world import Hole
from services.wire.messages import EpisodeSummary

TABLE, FELT = "table", "felt"
"""Who learns: the thesis's ART2 with Q-learning and softmax, and Treenail's felt learner."""
LEARNERS = (TABLE, FELT)
WHO = (*LEARNERS, *RULES)
FIRST_SEED = 100
"""Seed 0 of a report is this: nobody tunes on the seeds from here on."""
OTHER_SEEDS = 1000
"""Added to a seed where something frozen is tried: other starts, other noise."""
EPISODES, QUICK_EPISODES = 150, 4
PLAYED, QUICK_PLAYED = 40, 2
"""Episodes of who learns nothing: all count."""
ROUND = {TABLE: "chamfered-q-softmax", FELT: "suite-round"}
SHAPES = ("round", "square", "triangle")
AXES: Mapping[str, tuple[tuple[str, object], ...]] = {
    "along the tool's": (),
    "a quarter turn about Z": (("sensor_rz_deg", 90.0),),
    "a quarter turn about Y": (("sensor_ry_deg", 90.0),),
    "any, another with each seed": (("sensor_mount", "unknown"),),
}
"""How the sensor's axes stand."""
HOLES: Mapping[str, Hole] = {
    "upright": Hole(),
    "3 degrees about X": Hole(rx_deg=3.0),
    "3 degrees about Y": Hole(ry_deg=3.0),
    "up to 3, another way each time": Hole(tilt_spread_deg=3.0),
}
"""How the hole's axis stands; nobody is told."""


@dataclass(frozen=True)
class Went:
    """How some episodes went, one entry an episode."""

    outcomes: str
    """One letter an episode, see ``insertion_runs.LETTERS``."""
    force_n: list[float]
    returns: list[float]


@dataclass(frozen=True)
class Play:
    """A run of one who learns from nothing, or of a rule."""

    where: str
    who: str
    definition_sha256: str
    seed: int
    episodes: int
    version: int = 1


@dataclass(frozen=True)
class Chain:
    """Runs of one learner of which the later begin with what the earlier learnt."""

    what: str
    """``starts`` or ``shapes``."""
    who: str
    definitions_sha256: tuple[str, ...]
    seed: int
    episodes: int
    played: int
    version: int = 1


class Place(NamedTuple):
    """Where something is tried: a claim, and one of its conditions."""

    claim: str
    condition: str


PLACES = (*(Place("axes", name) for name in AXES), *(Place("hole", name) for name in HOLES))


def start_of_thesis() -> Definition:
    """Return the task whose start is the thesis's of the round peg (6.2.1)."""
    return load(ROUND[TABLE])


def task(place: Place, who: str) -> Definition:
    """Return the task of a condition as one meets it; the world is the same for all."""
    start = start_of_thesis().start
    if place.claim == "hole":
        definition = replace(load(ROUND[TABLE if who == TABLE else FELT]), start=start)
        return replace(definition, hole=HOLES[place.condition])
    # The felt learner takes torques as they are read where nobody says how the sensor's axes stand.
    definition = replace(load(ROUND[TABLE] if who == TABLE else "suite-turned"), start=start)
    fields = {"sensor_mount": "given", **dict(AXES[place.condition])}
    return replace(definition, wrist=replace(definition.wrist, **fields))


def shape(who: str, name: str) -> Definition:
    """Return the task with a peg of a shape: the thesis's from its start, the suite's from random ones."""
    if who != TABLE:
        return load(f"suite-{name}")
    if name == "round":
        return start_of_thesis()
    square = load("square-q-softmax")
    return replace(square, parts=replace(square.parts, shape=name))


def starts(who: str) -> tuple[Definition, Definition]:
    """Return the round peg's task from the thesis's start, and from anywhere within 2 mm and 1.5 degrees."""
    definition = load(ROUND[TABLE if who == TABLE else FELT])
    return replace(definition, start=start_of_thesis().start), replace(definition, start=load(ROUND[FELT]).start)


def plays(seeds: Iterable[int], episodes: int, played: int) -> list[Play]:
    """Return the runs of the first two claims, all conditions of a seed and then the next."""
    return [
        Play(
            f"{place.claim}: {place.condition}",
            who,
            definition_sha256(task(place, who)),
            seed + FIRST_SEED,
            episodes if who in LEARNERS else played,
        )
        for seed in seeds
        for place in PLACES
        for who in WHO
    ]


def chains(what: str, seeds: Iterable[int], episodes: int, played: int) -> list[Chain]:
    """Return the runs of the other two."""
    return [
        Chain(
            what,
            who,
            tuple(definition_sha256(definition) for definition in _tasks(what, who)),
            seed + FIRST_SEED,
            episodes,
            played,
        )
        for seed in seeds
        for who in LEARNERS
    ]


def _tasks(what: str, who: str) -> tuple[Definition, ...]:
    return starts(who) if what == "starts" else tuple(shape(who, name) for name in SHAPES)


def play(key: Play) -> Went:
    """Make a run."""
    claim, _, condition = key.where.partition(": ")
    definition = task(Place(claim, condition), key.who)
    if key.who in LEARNERS:
        return _learn(definition, key.seed, key.episodes)[0]
    return _rule(definition, key.who, key.seed, key.episodes)


def chain(key: Chain) -> dict[str, Went]:
    """Make a chain of runs; each by its name."""
    return (_starts if key.what == "starts" else _shapes)(key)


def _starts(key: Chain) -> dict[str, Went]:
    at_one, at_random = starts(key.who)
    there = key.seed + OTHER_SEEDS
    one, learnt_at_one = _learn(at_one, key.seed, key.episodes)
    several, learnt_at_random = _learn(at_random, key.seed, key.episodes)
    went = {
        "learning at one start": one,
        "learning at random starts": several,
        "learnt at one, frozen there": _frozen(learnt_at_one, at_one, there, key.played),
        "learnt at one, frozen at random": _frozen(learnt_at_one, at_random, there, key.played),
        "learnt at random, frozen at random": _frozen(learnt_at_random, at_random, there, key.played),
        "learnt at one, learning on at random": _learn(at_random, there, key.episodes, learnt_at_one)[0],
    }
    return went | {f"{name} at random": _rule(at_random, name, there, key.played) for name in RULES}


def _shapes(key: Chain) -> dict[str, Went]:
    first, *others = SHAPES
    definition = shape(key.who, first)
    went, skill = _learn(definition, key.seed, key.episodes)
    told = {f"{first}, from nothing": went}
    before = first
    for name in others:
        definition = shape(key.who, name)
        skill = carried(skill, definition).skill
        told[f"{name}, frozen from {before}"] = _frozen(skill, definition, key.seed, key.played)
        told[f"{name}, from nothing"], _ = _learn(definition, key.seed, key.episodes)
        told[f"{name}, from {before}"], skill = _learn(definition, key.seed, key.episodes, skill)
        told |= {f"{name}, {rule}": _rule(definition, rule, key.seed, key.played) for rule in RULES}
        before = name
    return told


def _learn(
    definition: Definition, seed: int, episodes: int, skill: NamedSkill | None = None
) -> tuple[Went, NamedSkill]:
    run = InProcessRun(definition, seed, remember=True, skill=skill)
    return _went(run.episodes(episodes)), run.learnt()


def _frozen(skill: NamedSkill, definition: Definition, seed: int, episodes: int) -> Went:
    return _went(trial(definition, FrozenSkill(skill, definition, seed), seed, episodes).episodes)


def _rule(definition: Definition, name: str, seed: int, episodes: int) -> Went:
    return _went(trial(definition, Method(name).controller(definition, seed), seed, episodes).episodes)


def _went(episodes: Iterable[EpisodeSummary]) -> Went:
    summaries = list(episodes)
    return Went(
        "".join(LETTERS[summary.outcome] for summary in summaries),
        [summary.mean_force_n for summary in summaries],
        [summary.episode_return for summary in summaries],
    )
