"""The board itself: learning from nothing, beside who does not learn."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from experiments.lab.progress import Reporter
from experiments.leaderboard import curves
from experiments.leaderboard.board import Board, as_json, board, write
from experiments.leaderboard.folder import Folder
from experiments.leaderboard.jobs import Outcome
from experiments.leaderboard.page import facts, page
from experiments.leaderboard.plan import Entry, Length
from experiments.leaderboard.runner import Spread, run, there_is

TITLE = "Learning to insert, from nothing"
PAGE, NUMBERS = "leaderboard.md", "leaderboard.json"


def make(
    entries: Sequence[Entry], length: Length, folder: Folder, spread: Spread | None, reporter: Reporter
) -> tuple[Path, int]:
    """Run what is not done yet (nothing without ``spread``), write the page, return its path and how many runs failed.

    Raises what ``run`` and ``write`` raise.
    """
    jobs = [job for entry in entries for job in entry.jobs]
    results = there_is(folder, jobs) if spread is None else run("leaderboard", jobs, folder, spread, reporter)
    made, told = board(entries, results), facts(length)
    drawn = curves.pictures(_curves(made, learns=True), _curves(made, learns=False))
    text = page(TITLE, told, made, list(drawn))
    write(folder.path, {**drawn, PAGE: text.encode(), NUMBERS: as_json(told, made.rows)})
    return folder.path / PAGE, len(results.failures)


def _curves(made: Board, learns: bool) -> dict[str, dict[str, list[Outcome]]]:
    """Return the outcomes to draw, by task and method; what the oracle found in one episode is none."""
    return {
        task: {
            method.name: list(made.outcomes[task, method.name].values())
            for method in made.methods
            if (method.kind == "learn") == learns and method.kind != "oracle" and made.outcomes[task, method.name]
        }
        for task in made.tasks
    }
