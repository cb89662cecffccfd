"""Makes the study: runs what is not done yet, and writes the page, its picture and ``deep.json``."""

from __future__ import annotations

import json
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from experiments.deep import page, picture, runner
from experiments.deep.folding import Row, failed, row
from experiments.deep.jobs import Environment, Job, Learnt, Place
from experiments.deep.libraries import versions
from experiments.deep.plan import Study, tuning
from experiments.evaluate.controllers import RULES
from experiments.lab.progress import Reporter
from experiments.leaderboard import runner as leaderboard
from experiments.leaderboard.board import best_rule, write
from experiments.leaderboard.figures import Figures, figures, last_of
from experiments.leaderboard.folder import Folder
from experiments.leaderboard.jobs import LEARNER, Outcome
from experiments.leaderboard.methods import TREENAIL
from experiments.reproduce.cache import Cache
from experiments.reproduce.code import origin
from services.wire.errors import TreenailError

DEEP_RUNS = "deep-runs"


class Workshop(NamedTuple):
    """Where the study is made."""

    folder: Path
    environment: Environment
    processes: int | None
    """At a time; None: nothing is run, only what is there is told."""
    reporter: Reporter

    def deep(self, jobs: Sequence[Job]) -> dict[Job, Learnt]:
        """Return what came of some runs of deep learners. Raises what ``runner.run`` raises."""
        kept = Cache(self.folder / DEEP_RUNS, self.reporter.say)
        if self.processes is None:
            return runner.there_is(jobs, kept, self.environment)
        return runner.run(jobs, kept, self.environment, self.processes, self.reporter)


class Made(NamedTuple):
    """What there is."""

    outcomes: dict[str, dict[str, dict[int, Outcome]]]
    """By task, method and seed."""
    learnt: dict[Place, Learnt]
    """Of deep learners."""

    def rule(self, task: str) -> Figures | None:
        """Return the figures of the better of the two rules."""
        of_task = self.outcomes.get(task, {})
        made = {(task, name): figures(of_task[name], False) for name in RULES if of_task.get(name)}
        return best_rule(task, made)


def tune(study: Study, workshop: Workshop) -> list[page.Tried]:
    """Try settings on the tuning seeds, and return what came of those that there are results of."""
    learnt = workshop.deep(tuning(study.tasks[0], study.methods))
    by_method: dict[str, list[tuple[Job, Learnt]]] = {}
    for job, made in sorted(learnt.items(), key=lambda item: (item[0].method.name, item[0].seed)):
        by_method.setdefault(job.method.name, []).append((job, made))
    return [_tried(some) for some in by_method.values()]


def _tried(some: Sequence[tuple[Job, Learnt]]) -> page.Tried:
    job = some[0][0]
    last = last_of(job.episodes)
    ends = [(made.outcome.outcomes[-last:], made.outcome.force_n[-last:]) for _, made in some]
    force_n = statistics.fmean([value for _, forces in ends for value in forces])
    return page.Tried(job.method, failed("".join(letters for letters, _ in ends)), force_n)


def make(study: Study, workshop: Workshop) -> Made:
    """Run what is not done yet, or look what there is, and return it. Raises TreenailError."""
    folder = Folder(workshop.folder, workshop.reporter.say)
    folder.prepare()
    entries = study.others()
    others = [job for entry in entries for job in entry.jobs]
    if workshop.processes is None:
        results = leaderboard.there_is(folder, others)
    else:
        results = leaderboard.run("others", others, folder, leaderboard.here(workshop.processes), workshop.reporter)
    for failure, why in results.failures.items():
        raise TreenailError(f"{failure.name}: {why}")
    deep = workshop.deep(study.jobs() + study.longer_jobs())
    made = Made({task.name: {} for task in study.tasks}, {job.place: learnt for job, learnt in deep.items()})
    for other, outcome in results.outcomes.items():
        made.outcomes[other.task].setdefault(other.method, {})[other.seed] = outcome
    for job in study.jobs():
        if job.place in made.learnt:
            made.outcomes[job.task].setdefault(job.method.name, {})[job.seed] = made.learnt[job.place].outcome
    return made


def tell(study: Study, made: Made, tried: Sequence[page.Tried], target: Path, command: str) -> Path:
    """Write page, picture and numbers of what there is into a folder; return the page's path. Raises TreenailError."""
    path = target / f"{page.NAME}.md"
    rows = rows_of(study, made)
    if not rows:
        raise TreenailError("nothing has been run yet")
    longer = [_longer(job.place, made) for job in study.longer_jobs() if job.place in made.learnt]
    facts = {
        **origin(LEARNER),
        "libraries": ", ".join(f"{name} {number}" for name, number in versions().items()),
        "seeds": ", ".join(map(str, study.seeds)),
        "episodes": f"{study.episodes} of who learns, {study.length.baseline_episodes} of the rules",
    }
    text = page.Page(command, facts, rows, study.tasks, study.methods, tried, longer)
    drawn = {task: {name: list(seeds.values()) for name, seeds in of.items()} for task, of in made.outcomes.items()}
    numbers = {"facts": facts, "rows": rows, "longer": longer, "tried": [one._asdict() for one in tried]}
    files = {
        f"{page.NAME}.md": text.written(page.findings_of(_old(path))).encode(),
        f"{page.NAME}.png": picture.picture(drawn, study.methods),
        f"{page.NAME}.json": (json.dumps(numbers, indent=1, allow_nan=False, default=_plain) + "\n").encode(),
    }
    write(target, files)
    return path


def rows_of(study: Study, made: Made) -> list[Row]:
    """Return the rows of what there is, task by task: Treenail's own learner, the rules, the deep learners."""
    deep = {method.name for method in study.methods}
    names = (TREENAIL, *RULES, *(method.name for method in study.methods))
    rows = []
    for task in study.tasks:
        for name in names:
            outcomes = made.outcomes[task.name].get(name)
            if outcomes:
                places = [Place(task.name, name, seed, study.episodes) for seed in outcomes] if name in deep else []
                learnt = {place.seed: made.learnt[place] for place in places}
                rows.append(row(task.name, name, outcomes, made.rule(task.name), name not in RULES, learnt or None))
    return rows


def _longer(place: Place, made: Made) -> Row:
    learnt, rule = made.learnt[place], made.rule(place.task)
    return row(place.task, place.method, {place.seed: learnt.outcome}, rule, True, {place.seed: learnt})


def _old(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return ""


def _plain(value: object) -> object:
    """Return what JSON can hold of a method."""
    return {"name": value.name, "about": value.about}  # type: ignore[attr-defined]
