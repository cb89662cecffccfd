"""Makes a board: runs what is not done yet, and writes the page, its pictures and ``leaderboard.json``."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypedDict

from experiments.evaluate.controllers import RULES
from experiments.leaderboard.figures import Figures, figures, ratio
from experiments.leaderboard.jobs import Outcome
from experiments.leaderboard.methods import Method
from experiments.leaderboard.plan import Entry
from experiments.leaderboard.runner import Results
from experiments.leaderboard.targets import verdict
from services.wire.errors import TreenailError


class Row(TypedDict):
    """One method on one task, as in ``leaderboard.json``."""

    task: str
    method: str
    figures: Figures | None
    """None where nothing was run."""
    force_of_rule: float | None
    moves_of_rule: float | None
    verdict: str
    """Against the task's target; empty without one."""
    missing: list[str]
    """Why seeds are missing, each reason once."""


class Board(NamedTuple):
    """What came out."""

    rows: tuple[Row, ...]
    outcomes: Mapping[tuple[str, str], Mapping[int, Outcome]]
    """By task and method, then by seed."""
    methods: tuple[Method, ...]

    def row(self, task: str, method: str) -> Row | None:
        """Return the row of a method on a task."""
        return next((row for row in self.rows if (row["task"], row["method"]) == (task, method)), None)

    @property
    def tasks(self) -> list[str]:
        """Names of the tasks, in order."""
        return list(dict.fromkeys(row["task"] for row in self.rows))


def board(entries: Sequence[Entry], results: Results) -> Board:
    """Return the board of what has been run."""
    outcomes = {
        (entry.task, entry.method.name): {
            job.seed: results.outcomes[job] for job in entry.jobs if job in results.outcomes
        }
        for entry in entries
    }
    made = {
        (entry.task, entry.method.name): figures(of_seeds, entry.method.kind == "learn")
        for entry in entries
        if (of_seeds := outcomes[entry.task, entry.method.name])
    }
    rows = tuple(_row(entry, made, results) for entry in entries)
    return Board(rows, outcomes, tuple({entry.method.name: entry.method for entry in entries}.values()))


def _row(entry: Entry, made: Mapping[tuple[str, str], Figures], results: Results) -> Row:
    name = entry.method.name
    ours, rule = made.get((entry.task, name)), best_rule(entry.task, made)
    parts = None if ours is None or rule is None else ratio(ours, rule)
    words = ""
    if ours is not None and entry.target is not None:
        others = {task: of for (task, method), of in made.items() if method == name}
        words = verdict(entry.target, ours, rule, others).words
    reasons = [results.failures[job] for job in entry.jobs if job in results.failures]
    undone = sum(job not in results.outcomes and job not in results.failures for job in entry.jobs)
    if undone:
        reasons.append(f"{undone} of {len(entry.jobs)} seeds not run yet")
    return {
        "task": entry.task,
        "method": name,
        "figures": ours,
        "force_of_rule": None if parts is None else parts.force,
        "moves_of_rule": None if parts is None else parts.moves,
        "verdict": words,
        "missing": list(dict.fromkeys([entry.refused, *reasons]) if entry.refused else dict.fromkeys(reasons)),
    }


def best_rule(task: str, made: Mapping[tuple[str, str], Figures]) -> Figures | None:
    """Return the figures of that hand-written rule which inserts more often on a task, of equals the gentler."""
    rules = [of for rule in RULES if (of := made.get((task, rule))) is not None]
    return min(rules, key=lambda of: (-of["success"], of["force_n"]["mean"]), default=None)


def write(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files, each whole or not at all, over what is there. Raises TreenailError."""
    for name, content in files.items():
        path = folder / name
        part = path.with_name(f".{name}.{os.getpid()}")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            part.write_bytes(content)
            part.replace(path)
        except OSError as error:
            raise TreenailError(f"{path}: cannot be written: {error.strerror}") from error
        finally:
            part.unlink(missing_ok=True)


def as_json(facts: Mapping[str, str], rows: Sequence[Mapping[str, object]]) -> bytes:
    """Return the content of ``leaderboard.json``."""
    return (json.dumps({"facts": facts, "rows": rows}, indent=1, allow_nan=False) + "\n").encode()
