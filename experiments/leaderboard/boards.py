"""The boards there are: which tasks, methods, seeds and lengths each has, unless the command line says otherwise."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, TypeAlias

from experiments.lab.progress import Reporter
from experiments.leaderboard import ablation, lasting, learning, plan, rivals, transfer
from experiments.leaderboard.folder import Folder
from experiments.leaderboard.methods import TREENAIL, Kind, Method, beginning_with, methods
from experiments.leaderboard.plan import Length
from experiments.leaderboard.runner import Spread
from experiments.leaderboard.suite import CHANGING, QUICK, tasks
from services.wire.errors import TreenailError

Plan: TypeAlias = Callable[[Folder, Spread | None, Reporter], tuple[Path, int]]
"""Makes a board into a folder: runs it, or without a spread just looks what is there. Returns page and failures."""


class Wanted(NamedTuple):
    """What was asked for; None is whatever the board has by itself."""

    quick: bool = False
    tasks: list[str] | None = None
    methods: list[str] | None = None
    seeds: tuple[int, ...] | None = None
    episodes: int | None = None
    baseline_episodes: int | None = None
    skills: tuple[str, ...] = ()
    variants: tuple[tuple[str, ...], ...] = ()
    """Names, each with overrides behind it."""

    def length(
        self, seeds: tuple[int, ...], quick_seeds: tuple[int, ...], episodes: int, quick_episodes: int
    ) -> Length:
        """Return how much is run, of who does not learn as the leaderboard has it."""
        baseline = plan.QUICK_BASELINE_EPISODES if self.quick else plan.BASELINE_EPISODES
        return Length(
            self.seeds or (quick_seeds if self.quick else seeds),
            self.episodes or (quick_episodes if self.quick else episodes),
            self.baseline_episodes or baseline,
        )

    def varied(self) -> tuple[Method, ...]:
        """Return the task's learner with other settings, as they were asked for."""
        return tuple(Method(name, " ".join(overrides), "learn", tuple(overrides)) for name, *overrides in self.variants)

    def learners(self, *others: Kind) -> tuple[Method, ...]:
        """Return the methods asked for, Treenail's own if none is, that learn or are of ``others``, and ``varied``."""
        chosen = methods(self.methods or [TREENAIL])
        return (*(method for method in chosen if method.kind in ("learn", *others)), *self.varied())

    def usual(self) -> Length:
        """Return the leaderboard's own."""
        return self.length(plan.SEEDS, plan.QUICK_SEEDS, plan.EPISODES, plan.QUICK_EPISODES)


def _learning(wanted: Wanted) -> Plan:
    length = wanted.usual()
    some = (*methods(wanted.methods), *wanted.varied(), *map(beginning_with, wanted.skills))
    entries = plan.entries(tasks(wanted.tasks, wanted.quick), some, length)
    return lambda folder, spread, reporter: learning.make(
        learning.LEADERBOARD, entries, length, folder, spread, reporter
    )


def _ablation(wanted: Wanted) -> Plan:
    if wanted.methods is not None:
        raise TreenailError("--methods: expected none with --ablation, whose methods are the parts that are left out")
    length = wanted.usual()
    chosen = wanted.tasks or list(ablation.TASKS[:2] if wanted.quick else ablation.TASKS)
    entries = plan.entries(tasks(chosen), ablation.methods(), length)
    return lambda folder, spread, reporter: learning.make(learning.ABLATION, entries, length, folder, spread, reporter)


def _transfer(wanted: Wanted) -> Plan:
    if wanted.tasks is not None:
        raise TreenailError("--tasks: expected none with --transfer, which has cases of its own")
    some, length = wanted.learners("play"), wanted.usual()
    return lambda folder, spread, reporter: transfer.make(some, length, folder, spread, reporter)


def _long(wanted: Wanted) -> Plan:
    length = wanted.length(lasting.SEEDS, lasting.QUICK_SEEDS, lasting.EPISODES, lasting.EPISODES)
    chosen = wanted.tasks or ([QUICK[0], f"{CHANGING}*"] if wanted.quick else ["suite-*"])
    entries = plan.entries(tasks(chosen), wanted.learners(), length)
    return lambda folder, spread, reporter: lasting.make(entries, length, folder, spread, reporter)


def _rivals(wanted: Wanted) -> Plan:
    length = wanted.length(rivals.SEEDS, rivals.QUICK_SEEDS, rivals.EPISODES, rivals.QUICK_EPISODES)
    parts = rivals.plan(tasks(wanted.tasks or list(rivals.TASKS)), rivals.methods(wanted.methods), length)
    return lambda folder, spread, reporter: rivals.make(parts, folder, spread, reporter)


BOARDS: dict[str, Callable[[Wanted], Plan]] = {
    "learning": _learning,
    "ablation": _ablation,
    "transfer": _transfer,
    "long": _long,
    "rivals": _rivals,
}
"""Each reads what was asked for, and says what is wrong with it before anything runs."""
