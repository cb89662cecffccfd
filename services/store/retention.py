"""Which keys the store may forget, so that it stays bounded and a run can still be resumed from what is left.

A checkpoint numbered E holds a service's state after all episodes below E; to go on from it, the journal from E on is
needed. Keys that are not
of a run are never touched.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from services.rules.settings import check, setting
from services.wire.keys import CHECKPOINT, ENTRY, ROOT, Named, named


@dataclass(frozen=True, slots=True)
class RetentionSettings:
    """How much is kept. Raises ValueError for less than 1."""

    checkpoints: int = setting(10, "newest checkpoints per worker", "--keep-checkpoints", within=(1, 10**9))
    """Numbered ones, for each cell, run and service."""
    journal_episodes: int = setting(100_000, "journal episodes per run", "--keep-episodes", within=(1, 10**9))
    """Of each cell, unless more are needed after a kept checkpoint."""
    runs: int = setting(50, "newest runs", "--keep-runs", within=(1, 10**9))
    """Of each cell."""

    def __post_init__(self) -> None:
        check(self, ValueError)


@dataclass(slots=True)
class _Run:
    """What is stored of one run of one cell."""

    newest: str = ""
    keys: list[str] = field(default_factory=list)
    checkpoints: dict[str, list[tuple[int, str]]] = field(default_factory=dict)
    """By service; a service that only has ``latest`` is here with an empty list."""
    journal: list[tuple[int, str]] = field(default_factory=list)


def removable(stored: Iterable[tuple[str, str]], settings: RetentionSettings) -> list[str]:
    """Return the keys to remove, sorted, out of pairs of key and timestamp (text that sorts as time does).

    Of each cell the runs whose newest key is oldest go entirely; of the other runs only surplus numbered checkpoints
    (lowest numbers first) and surplus journal episodes (oldest first). Record, swaps and ``latest`` of a kept run stay.
    """
    cells: dict[str, dict[str, _Run]] = {}
    for key, timestamp in stored:
        cell, _, name = key.removeprefix(f"{ROOT}/").partition("/")
        what = named(name)
        if what is not None and "run" in what.parts:
            run = cells.setdefault(cell, {}).setdefault(what.parts["run"], _Run())
            _note(run, key, timestamp, what)
    surplus: list[str] = []
    for runs in cells.values():
        by_age = sorted(runs, key=lambda name: (runs[name].newest, name), reverse=True)
        for name in by_age[: settings.runs]:
            surplus += _surplus(runs[name], settings)
        for name in by_age[settings.runs :]:
            surplus += runs[name].keys
    return sorted(surplus)


def _note(run: _Run, key: str, timestamp: str, what: Named) -> None:
    run.keys.append(key)
    run.newest = max(run.newest, timestamp)
    if "service" in what.parts:
        numbered = run.checkpoints.setdefault(what.parts["service"], [])
        if what.pattern == CHECKPOINT and what.episode is not None:
            numbered.append((what.episode, key))
    elif what.pattern == ENTRY and what.episode is not None:
        run.journal.append((what.episode, key))


def _surplus(run: _Run, settings: RetentionSettings) -> list[str]:
    surplus: list[str] = []
    # Where a service stands that only has "latest" cannot be told from keys: it may need every episode.
    first_needed = 0 if not run.checkpoints or not all(run.checkpoints.values()) else 10**8
    for numbered in run.checkpoints.values():
        numbered.sort()
        surplus += [key for _, key in numbered[: -settings.checkpoints]]
        first_needed = min([first_needed, *(number for number, _ in numbered[-settings.checkpoints :])])
    episodes = sorted({episode for episode, _ in run.journal})
    first_kept = min([first_needed, *episodes[-settings.journal_episodes :]]) if episodes else 0
    return surplus + [key for episode, key in run.journal if episode < first_kept]
