"""What was learnt at random starts, frozen, and tried where it was never learnt: starts, friction, clearance, shape."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from experiments.lab.progress import Reporter
from experiments.leaderboard.folder import Folder
from experiments.leaderboard.jobs import Job
from experiments.leaderboard.learning import Title, tell
from experiments.leaderboard.methods import Method, variant
from experiments.leaderboard.plan import Entry, Length
from experiments.leaderboard.runner import Results, Spread, run, there_is
from experiments.leaderboard.targets import Target
from services.wire.definition import Definition
from services.wire.definition_file import load, shipped
from services.wire.errors import TreenailError

LEARNT_ON = "suite-round"
MOVES_OF = "suite-square"
"""The round peg is learnt with this task's moves: turned about its axis too, as a square one has to be."""
CARRIED = "learner.force_stays=true"
"""What makes a felt learner's skill hold elsewhere (docs/decisions/0043-force-stays.md); a method may say otherwise."""
OTHER_SEEDS = 1000
"""What is added to a seed: start poses and noise are others than those that were learnt with."""


class Case(NamedTuple):
    """Somewhere to try a skill."""

    name: str
    overrides: tuple[str, ...] = ()
    task: str = LEARNT_ON
    success: float | None = 0.99
    """What is aimed at."""


def _start(x_mm: float, y_mm: float, rx_deg: float, ry_deg: float) -> tuple[str, ...]:
    values = {
        "x_mm": x_mm,
        "y_mm": y_mm,
        "rx_deg": rx_deg,
        "ry_deg": ry_deg,
        "xy_spread_mm": 0.0,
        "tilt_spread_deg": 0.0,
    }
    return tuple(f"start.{name}={value}" for name, value in values.items())


CASES = (
    Case("as learnt"),
    Case("the thesis's start", _start(1.6, -2.2, 1.8, 0.4)),
    Case("the thesis's start, mirrored", _start(-1.6, 2.2, -1.8, -0.4)),
    Case("wider starts, 2.4 mm and 2.5 degrees", ("start.xy_spread_mm=2.4", "start.tilt_spread_deg=2.5")),
    *(Case(f"friction {value}", (f"contact.friction={value}",)) for value in (0.1, 0.2, 0.45, 0.6)),
    Case("friction 0.8", ("contact.friction=0.8",), success=0.95),
    *(Case(f"clearance {value} mm", (f"parts.clearance_mm={value}",)) for value in (0.1, 0.2, 0.35)),
    Case("clearance 0.05 mm", ("parts.clearance_mm=0.05",), success=None),
    Case("square", task="suite-square"),
    Case("triangle", task="suite-triangle", success=None),
    Case("rectangle", task="suite-rectangle", success=None),
)
"""To try it somewhere else, add a row; one whose task is not there is left out."""

TITLE = Title(
    "transfer",
    "A skill where it was never learnt",
    f"""Each learner learns `{LEARNT_ON}` from nothing, with the moves of `{MOVES_OF}` and, where it feels, with
`learner.force_stays`. Then it is frozen: nothing is learnt any more, no move is tried but the best that is surely
known. So it is tried on other starts and noise, and under other conditions, with a hand-written rule beside it; all
episodes count. *Failures in the first 20* are of the frozen skill's, success is with its 95 % interval (Wilson) and, in
square brackets, the worst seed's, forces are means over all moves of an episode, in brackets the least and the most of
the seeds' means.""",
)


def make(
    methods: Sequence[Method], length: Length, folder: Folder, spread: Spread | None, reporter: Reporter
) -> tuple[Path, int]:
    """Learn what is not learnt yet, try it, write the page, return its path and how many runs failed.

    Raises what ``runner.run`` and ``board.write`` raise.
    """

    def done(what: str, jobs: Sequence[Job]) -> Results:
        return there_is(folder, jobs) if spread is None else run(what, jobs, folder, spread, reporter)

    learners = [method for method in methods if method.kind == "learn"]
    learn = [_learn(method, seed, length.episodes) for method in learners for seed in length.seeds]
    learnt = done("transfer: learning", learn)
    cases = [case for case in CASES if case.task in shipped()]
    entries = [_entry(case, method, length, learnt, folder) for case in cases for method in methods]
    tried = done("transfer: trying", [job for entry in entries for job in entry.jobs])
    failures = {**learnt.failures, **tried.failures}
    return tell(TITLE, entries, length, folder, Results(tried.outcomes, failures)), len(failures)


def task_of(case: Case, method: Method) -> Definition:
    """Return the definition of a case, as a method's learner meets it: one whose skill is to be carried elsewhere."""
    first = () if method.skill is not None else (CARRIED,)
    task = variant(load(case.task), (*first, *method.overrides, *case.overrides), case.name, method.plain)
    return replace(task, moves=load(MOVES_OF).moves)


def _learn(method: Method, seed: int, episodes: int) -> Job:
    return Job(LEARNT_ON, method.name, "learn", task_of(Case(LEARNT_ON), method), seed, episodes)


def _entry(case: Case, method: Method, length: Length, learnt: Results, folder: Folder) -> Entry:
    """Return the row of a method in a case; there are jobs for what has been learnt."""
    task, count = task_of(case, method), length.baseline_episodes
    if method.kind != "learn":
        seeds = [seed + OTHER_SEEDS for seed in length.seeds]
        return Entry(case.name, method, tuple(Job(case.name, method.name, "play", task, seed, count) for seed in seeds))
    frozen = method._replace(kind="frozen")
    jobs, refused = list[Job](), ""
    for learn, outcome in learnt.outcomes.items():
        if learn.method == method.name:
            try:
                skill = folder.skill(outcome)
            except TreenailError as error:
                refused = str(error)
                continue
            jobs.append(Job(case.name, method.name, "frozen", task, learn.seed + OTHER_SEEDS, count, skill))
    target = None if case.success is None else Target((case.name,), success=case.success)
    return Entry(case.name, frozen, tuple(jobs), refused, target)
