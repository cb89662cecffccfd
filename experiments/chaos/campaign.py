"""A campaign: run after run is disturbed by the plan while it learns, and each has to end as one left in peace."""

from __future__ import annotations

import shutil
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from experiments.chaos.cell import ChaosCell, Order
from experiments.chaos.clocks import Clocks
from experiments.chaos.drive import Done, drive
from experiments.chaos.plan import Disturbance, Plan
from experiments.chaos.reference import Reference, Verdict, compare, undisturbed
from experiments.chaos.watch import Watch
from experiments.lab.progress import Reporter
from services.cell.ended import EndedRun, result_of
from services.rules.results import Digests
from services.wire.definition import Definition
from services.wire.errors import TreenailError
from services.wire.keys import ENTRY, name_of
from services.wire.messages import JournalEpisode


class Settings(NamedTuple):
    """What is run, and where."""

    experiment: str
    overrides: tuple[str, ...]
    swaps: tuple[str, ...]
    """What is swapped in each run, in the words of ``services.rules.swaps.spec``."""
    definition: Definition
    episodes: int
    first_seed: int
    viewer: bool
    out: Path
    """Folder for what the cells leave."""


@dataclass
class RunReport:
    """One run of a campaign."""

    seed: int
    far: str | None
    done: list[Done] = field(default_factory=list)
    decisions: int = 0
    digests: Digests | None = None
    expected: Digests | None = None
    verdict: Verdict | None = None
    error: str | None = None
    """Why it did not come to its end."""
    surprises: list[str] = field(default_factory=list)
    """Processes that ended by themselves."""
    tapped: Mapping[str, int] = field(default_factory=dict)
    """What the tap did."""

    @property
    def good(self) -> bool:
        """Whether it ended as the undisturbed run."""
        return self.error is None and self.verdict is not None and self.verdict.equal and not self.verdict.lost_steps


def carry_out(
    settings: Settings,
    plan: Plan,
    clocks: Clocks | None,
    shown: Reporter,
    reference: Callable[[Definition, int, int], Reference] = undisturbed,
) -> list[RunReport]:
    """Carry a plan out and return a report for each run that it took; stops after the first that does not end well.

    The runs have the seeds from ``settings.first_seed`` on.
    """
    reports: list[RunReport] = []
    reach, number = shown.begin("chaos", len(plan.disturbances), "disturbances"), 0

    def tell(done: Done) -> None:
        nonlocal number
        number += 1
        how = "the run ended" if done.pause_s is None else f"learning stood still for {done.pause_s:.2f} s"
        names = " ".join((done.planned.kind, *done.planned.victims))
        shown.say(f"{names}: {how}")
        reach(number)

    for section in plan.sections:
        todo = deque(section.disturbances)
        while todo:
            seed = settings.first_seed + len(reports)
            report = RunReport(seed, section.far)
            reports.append(report)
            behind = "" if section.far is None else f", {section.far} behind a tap"
            shown.say(f"seed {seed}, {settings.episodes} episodes{behind}")
            expected = reference(settings.definition, seed, settings.episodes)
            _run(settings, report, todo, clocks, expected, tell)
            if not report.good:
                return reports
            if not report.done:
                raise TreenailError(
                    f"--episodes: expected enough for a disturbance after {todo[0].after} decisions, "
                    f"got {settings.episodes}, which had {report.decisions}"
                )
    return reports


def _run(
    settings: Settings,
    report: RunReport,
    todo: deque[Disturbance],
    clocks: Clocks | None,
    expected: Reference,
    tell: Callable[[Done], None],
) -> None:
    """Disturb one run, and note in its report how it went."""
    out = settings.out / f"seed-{report.seed}"
    order = Order(
        settings.experiment,
        settings.overrides,
        settings.swaps,
        report.seed,
        settings.episodes,
        out,
        settings.viewer,
    )
    report.expected = expected.result.digests
    try:
        cell = ChaosCell(order, report.far, clocks)
        try:
            with cell, cell.client() as client:
                watch = Watch(client, cell.plan.run)
                drive(cell, watch, todo, report.done, tell)
                ended = EndedRun(cell.plan.run, settings.definition, report.seed, settings.episodes, 0)
                result = result_of(client, ended, cell.check)
                journal = client.ask_all(name_of(ENTRY, run=ended.run), JournalEpisode, 30.0)
        finally:
            report.surprises, report.tapped = cell.surprises, cell.tapped
    except TreenailError as error:
        report.error = f"{error}; logs in {out / 'logs'}"
        return
    report.decisions = sum(summary.decisions for summary in result.episodes)
    report.digests, report.verdict = result.digests, compare(result, journal, expected)
    if report.good:
        shutil.rmtree(out)
