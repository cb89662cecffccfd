"""The controllers of the thesis's chapter 2 beside the learner and the rules: what each was told, and what it came to.

Two questions, each on the same seeds: what comes of learning at random starts, and what of one who learnt, or was
taught, at one start only and then is tried at random ones, learning no more.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from experiments.evaluate.controllers import RULES
from experiments.lab.progress import Reporter
from experiments.leaderboard.board import as_json, board, write
from experiments.leaderboard.folder import Folder
from experiments.leaderboard.jobs import Job
from experiments.leaderboard.methods import METHODS, RIVALS, TREENAIL, Method, changed, variant
from experiments.leaderboard.page import facts
from experiments.leaderboard.plan import Entry, Length, entries
from experiments.leaderboard.rivals_page import page
from experiments.leaderboard.runner import Results, Spread, run, there_is
from experiments.leaderboard.transfer import OTHER_SEEDS
from services.wire.definition import Definition
from services.wire.errors import DefinitionError, TreenailError

FILE = "rivals"
TASKS = ("suite-round", "suite-square")
SEEDS, QUICK_SEEDS = (100, 101, 102), (100,)
EPISODES, QUICK_EPISODES = 300, 60
BESIDE = (TREENAIL, "table", *RULES)
"""Methods of the leaderboard that the rivals are held against."""
ONE_START = {
    "round": (1.6, -2.2, 1.8, 0.4, 0.0),
    "other": (-0.6, 0.2, -1.8, 1.4, -0.9),
}
"""The thesis's starts of the round peg and of the square one: x, y [mm], rx, ry, rz [deg]."""


class Parts(NamedTuple):
    """The entries of both questions."""

    random: tuple[Entry, ...]
    """From nothing, at random starts."""
    learn: tuple[Job, ...]
    """At one start, to be frozen."""
    length: Length
    tasks: tuple[Definition, ...]
    methods: tuple[Method, ...]


def methods(names: list[str] | None) -> tuple[Method, ...]:
    """Return the board's methods, or those of these names with the rules among them. Raises TreenailError."""
    every = tuple(method for method in (*METHODS, *RIVALS) if method in RIVALS or method.name in BESIDE)
    by_name = [method.name for method in every]
    for name in names or ():
        if name not in by_name:
            raise TreenailError(f"--methods: expected some of {', '.join(by_name)}, got {name!r}")
    return tuple(method for method in every if names is None or method.name in {*names, *RULES, TREENAIL})


def at_one_start(task: Definition) -> Definition:
    """Return a task that begins every episode where the thesis's did."""
    start = ONE_START["round" if task.parts.shape == "round" else "other"]
    named = zip(("x_mm", "y_mm", "rx_deg", "ry_deg", "rz_deg"), start, strict=True)
    fixed = [f"start.{name}={value}" for name, value in named]
    none = [f"start.{name}=0.0" for name in ("xy_spread_mm", "tilt_spread_deg")]
    return variant(task, (*fixed, *none), f"{task.name}, one start")


def plan(tasks: Sequence[Definition], some: Sequence[Method], length: Length) -> Parts:
    """Return what there is to do. What a task refuses is told with its entry."""
    learn = [
        Job(task.name, method.name, "learn", changed(at_one_start(task), method), seed, length.episodes)
        for task in tasks
        for method in some
        if method.kind == "learn" and _fits(task, method)
        for seed in length.seeds
    ]
    return Parts(entries(tasks, some, length), tuple(learn), length, tuple(tasks), tuple(some))


def make(parts: Parts, folder: Folder, spread: Spread | None, reporter: Reporter) -> tuple[Path, int]:
    """Run what is not done yet, write the page, return its path and how many runs failed.

    Raises what ``runner.run`` and ``board.write`` raise.
    """

    def done(what: str, jobs: Sequence[Job]) -> Results:
        return there_is(folder, jobs) if spread is None else run(what, jobs, folder, spread, reporter)

    first = done("rivals: learning", [*(job for entry in parts.random for job in entry.jobs), *parts.learn])
    unseen = [_unseen(task, method, parts, first, folder) for task in parts.tasks for method in parts.methods]
    second = done("rivals: unseen starts", [job for entry in unseen for job in entry.jobs])
    told = facts(parts.length)
    random, other = board(parts.random, first), board(unseen, second)
    rows = [{"starts": "random", **row} for row in random.rows] + [{"starts": "unseen", **row} for row in other.rows]
    write(
        folder.path,
        {f"{FILE}.md": page(told, random, other).encode(), f"{FILE}.json": as_json(told, rows)},
    )
    return folder.path / f"{FILE}.md", len({**first.failures, **second.failures})


def _fits(task: Definition, method: Method) -> bool:
    try:
        changed(task, method)
    except DefinitionError:
        return False
    return True


def _unseen(task: Definition, method: Method, parts: Parts, learnt: Results, folder: Folder) -> Entry:
    """Return the row of a method that learnt, or was taught, at one start, at random ones; none where nothing is."""
    count = parts.length.baseline_episodes
    if not _fits(task, method):
        return Entry(task.name, method, ())
    own = changed(task, method)
    if method.kind != "learn":
        at = at_one_start(own) if method.kind == "taught" else None
        jobs = [
            Job(task.name, method.name, method.kind, own, seed + OTHER_SEEDS, count, taught_on=at)
            for seed in parts.length.seeds
        ]
        return Entry(task.name, method, tuple(jobs))
    frozen = [
        Job(task.name, method.name, "frozen", own, job.seed + OTHER_SEEDS, count, folder.skill(outcome))
        for job in parts.learn
        if (job.task, job.method) == (task.name, method.name) and (outcome := learnt.outcomes.get(job)) is not None
    ]
    return Entry(task.name, method._replace(kind="frozen"), tuple(frozen))
