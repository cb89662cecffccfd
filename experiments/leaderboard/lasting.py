"""Does it keep what it has learnt? Long runs, and tasks that change in the course of them."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypedDict

from experiments.lab.progress import Reporter
from experiments.leaderboard import curves
from experiments.leaderboard.board import as_json, write
from experiments.leaderboard.figures import INSERTED
from experiments.leaderboard.folder import Folder
from experiments.leaderboard.jobs import Outcome
from experiments.leaderboard.page import facts, percent, table
from experiments.leaderboard.plan import Entry, Length
from experiments.leaderboard.runner import Spread, run, there_is
from experiments.leaderboard.suite import change_of

EPISODES = 1800
SEEDS, QUICK_SEEDS = (100, 101, 102), (100,)
WINDOW, GOOD = 100, 99
"""A window of so many episodes is good when so many succeed."""
RECOVERY_EPISODES = 50
"""Within so many episodes after a change the window that begins is to be good again."""
FILE, TITLE = "long", "What is kept over a long run"
HOW = f"""Each run learns from nothing and goes on for long. The *first good window* is where the first {WINDOW}
episodes in a row begin of which {GOOD} succeed; the *worst after it* is the least success of any {WINDOW} episodes in
a row from there on, which is to be {GOOD} % or more: nothing is forgotten. A task that changes says when; *recovered
after* is how many episodes later the first good window begins, which is to be within {RECOVERY_EPISODES}, and the worst
window is looked for before the change and after the recovery only. In brackets are the most of the seeds."""


class Kept(NamedTuple):
    """How a run kept what it had learnt."""

    good_from: int | None
    """Episode at which the first good window begins, None when there is none."""
    worst: int | None
    """Successes in the worst window after it, of those that no change lies in."""
    recovered_after: int | None = None
    """Episodes from the change to the first good window; None when it never comes, or when nothing changes."""


class Row(TypedDict):
    """One method on one task."""

    task: str
    method: str
    changes_at: int | None
    seeds: list[int]
    good_from: list[int | None]
    worst: list[int | None]
    recovered_after: list[int | None]
    met: bool | None
    """None where nothing was run."""
    missing: list[str]


def kept(outcomes: str, changes_at: int | None = None) -> Kept:
    """Return how a run kept what it had learnt, of one letter an episode; ``changes_at`` is when its task changed."""
    inserted = [letter == INSERTED for letter in outcomes]
    counts = [sum(inserted[begin : begin + WINDOW]) for begin in range(len(inserted) - WINDOW + 1)]
    good_from = _good(counts, 0)
    if good_from is None:
        return Kept(None, None)
    if changes_at is None or changes_at >= len(inserted):
        return Kept(good_from, min(counts[good_from:]))
    again = _good(counts, changes_at)
    before = counts[good_from : max(changes_at - WINDOW + 1, good_from)]
    after = [] if again is None else counts[again:]
    worst = min([*before, *after], default=None)
    return Kept(good_from, worst, None if again is None else again - changes_at)


def _good(counts: Sequence[int], first: int) -> int | None:
    return next((begin for begin in range(first, len(counts)) if counts[begin] >= GOOD), None)


def make(
    entries: Sequence[Entry], length: Length, folder: Folder, spread: Spread | None, reporter: Reporter
) -> tuple[Path, int]:
    """Run what is not done yet, write the page, return its path and how many runs failed; raises what these raise."""
    jobs = [job for entry in entries for job in entry.jobs]
    results = there_is(folder, jobs) if spread is None else run(FILE, jobs, folder, spread, reporter)
    outcomes = {
        (entry.task, entry.method.name): {
            job.seed: results.outcomes[job] for job in entry.jobs if job in results.outcomes
        }
        for entry in entries
    }
    rows = [_row(entry, outcomes[entry.task, entry.method.name]) for entry in entries]
    told = facts(length)
    drawn = curves.pictures(FILE, _by_task(outcomes), {})
    write(
        folder.path,
        {**drawn, f"{FILE}.md": _page(told, rows, list(drawn)).encode(), f"{FILE}.json": as_json(told, rows)},
    )
    return folder.path / f"{FILE}.md", len(results.failures)


def _row(entry: Entry, outcomes: Mapping[int, Outcome]) -> Row:
    changes_at = change_of(entry.jobs[0].definition) if entry.jobs else None
    seeds = sorted(outcomes)
    each = [kept(outcomes[seed].outcomes, changes_at) for seed in seeds]
    missing = len(entry.jobs) - len(seeds)
    return {
        "task": entry.task,
        "method": entry.method.name,
        "changes_at": changes_at,
        "seeds": seeds,
        "good_from": [of.good_from for of in each],
        "worst": [of.worst for of in each],
        "recovered_after": [of.recovered_after for of in each],
        "met": all(_met(of, changes_at) for of in each) if each else None,
        "missing": [entry.refused or f"{missing} seeds not run"] if entry.refused or missing else [],
    }


def _met(run: Kept, changes_at: int | None) -> bool:
    if run.worst is None or run.worst < GOOD:
        return False
    return changes_at is None or (run.recovered_after is not None and run.recovered_after <= RECOVERY_EPISODES)


def _by_task(outcomes: Mapping[tuple[str, str], Mapping[int, Outcome]]) -> dict[str, dict[str, list[Outcome]]]:
    drawn: dict[str, dict[str, list[Outcome]]] = {}
    for (task, method), of_seeds in outcomes.items():
        if of_seeds:
            drawn.setdefault(task, {})[method] = list(of_seeds.values())
    return drawn


def _page(told: Mapping[str, str], rows: Sequence[Row], pictures: Sequence[str]) -> str:
    head = ("task", "method", "first good window", "worst after it [%]", "recovered after", "verdict")
    cells = [
        (
            row["task"] + ("" if row["changes_at"] is None else f" (changes at {row['changes_at']})"),
            f"`{row['method']}`",
            _median_and_most(row["good_from"]),
            _least(row["worst"]),
            "" if row["changes_at"] is None else _median_and_most(row["recovered_after"]),
            "; ".join([*({True: ["kept"], False: ["missed"], None: list[str]()}[row["met"]]), *row["missing"]]),
        )
        for row in rows
    ]
    parts = [f"# {TITLE}", HOW, "\n".join(f"- {label}: {text}" for label, text in told.items()), table(head, cells)]
    return "\n\n".join([*parts, *(f"![{name.removesuffix('.png')} by episode]({name})" for name in pictures)]) + "\n"


def _median_and_most(values: Sequence[int | None]) -> str:
    """Return the median of the seeds and the most; one that never came is the most."""
    if not values:
        return ""
    ends = sorted(float("inf") if value is None else value for value in values)
    median, most = statistics.median_low(ends), ends[-1]
    return " (".join("never" if value == float("inf") else f"{value:g}" for value in (median, most)) + ")"


def _least(values: Sequence[int | None]) -> str:
    some = [value for value in values if value is not None]
    return percent(min(some) / WINDOW) if some else ""
