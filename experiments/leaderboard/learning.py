"""Boards of learning from nothing: all methods on the suite, and the learner with each of its parts left out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from experiments.lab.progress import Reporter
from experiments.leaderboard import at_a_glance, curves
from experiments.leaderboard.board import Board, as_json, board, write
from experiments.leaderboard.folder import Folder
from experiments.leaderboard.jobs import Outcome
from experiments.leaderboard.page import LEARNING, facts, page
from experiments.leaderboard.plan import Entry, Length
from experiments.leaderboard.runner import Results, Spread, run, there_is


class Title(NamedTuple):
    """What a board is called."""

    file: str
    """The beginning of its files' names."""
    text: str
    how: str = LEARNING


LEADERBOARD = Title("leaderboard", "Learning to insert, from nothing")
ABLATION = Title("ablation", "The learner with each of its parts left out")


def make(
    title: Title,
    entries: Sequence[Entry],
    length: Length,
    folder: Folder,
    spread: Spread | None,
    reporter: Reporter,
) -> tuple[Path, int]:
    """Run what is not done yet (nothing without ``spread``), write the page, return its path and how many runs failed.

    Raises what ``run`` and ``write`` raise.
    """
    jobs = [job for entry in entries for job in entry.jobs]
    results = there_is(folder, jobs) if spread is None else run(title.file, jobs, folder, spread, reporter)
    return tell(title, entries, length, folder, results), len(results.failures)


def tell(title: Title, entries: Sequence[Entry], length: Length, folder: Folder, results: Results) -> Path:
    """Write page, pictures and numbers of what has been run, and return the page's path. Raises TreenailError."""
    made, told = board(entries, results), facts(length)
    drawn = curves.pictures(title.file, _curves(made, learns=True), _curves(made, learns=False))
    if title is LEADERBOARD and (glance := at_a_glance.picture(made)) is not None:
        drawn = {f"{title.file}.png": glance, **drawn}
    text = page(title.text, title.how, told, made, list(drawn))
    numbers = as_json(told, made.rows)
    write(folder.path, {**drawn, f"{title.file}.md": text.encode(), f"{title.file}.json": numbers})
    return folder.path / f"{title.file}.md"


def _curves(made: Board, learns: bool) -> dict[str, dict[str, list[Outcome]]]:
    """Return the outcomes to draw, by task and method: of who learns, or of the controllers."""
    return {
        task: {
            method.name: list(made.outcomes[task, method.name].values())
            for method in made.methods
            if method.kind == ("learn" if learns else "play") and made.outcomes.get((task, method.name))
        }
        for task in made.tasks
    }
