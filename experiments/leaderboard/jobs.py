"""The runs behind a board: each is a job that any process can do, on this machine or another, with the same result."""

from __future__ import annotations

import time
import traceback
from collections.abc import Sequence
from functools import cache
from typing import Any

import msgspec

from experiments.evaluate.controllers import BASELINES, PUSH
from experiments.evaluate.frozen import FrozenSkill
from experiments.evaluate.run import Method as Controlled
from experiments.evaluate.trial import trial
from experiments.lab.pool import Tell
from experiments.lab.run import run_seed
from experiments.leaderboard.methods import Kind, task_alone
from experiments.leaderboard.suite import SLOW_MOVES, moves_expected
from experiments.oracle.search import Effort, search
from experiments.reproduce.code import code_sha256
from experiments.reproduce.insertion_runs import LETTERS
from experiments.rivals.taught import TAUGHT
from services.rules.hole import tilt_deg
from services.rules.results import Digests
from services.rules.skill import NamedSkill, file_bytes
from services.task.insertion import Insertion
from services.wire.definition import SPREADS, Definition, Plugin
from services.wire.definition_file import definition_sha256
from services.wire.errors import TreenailError
from services.wire.messages import EpisodeSummary

TASK = ("services.rules", "services.sim", "services.task")
"""Packages that decide how an insertion goes, whoever decides."""
LEARNER = (*TASK, "services.agent", "services.classifier")
PACKAGES: dict[Kind, tuple[str, ...]] = {
    "learn": LEARNER,
    "frozen": (*LEARNER, "experiments.evaluate"),
    "play": (*TASK, "experiments.evaluate"),
    "oracle": (*TASK, "experiments.oracle"),
    "taught": (*TASK, "services.classifier", "experiments.evaluate", "experiments.oracle", "experiments.rivals"),
}
"""Packages whose code decides what comes out of a job."""
PLUGINS = ("experiments.rivals",)
"""Whose code counts too where a definition names a plug-in."""
WITHOUT_LEARNER: tuple[Kind, ...] = ("play", "oracle", "taught")
"""Read of a definition what the task is, whatever learner stands in it."""
ORACLE, SLOW_ORACLE = Effort(beam=4, attempts=60), Effort(beam=1, attempts=20)
"""What the oracle's search may cost for a start, also where an insertion takes more than ``SLOW_MOVES``: seconds."""
_COSTS = {"random": 5.0, "oracle": 100.0}
"""How many insertions one of these is like."""
VERSION = 1
"""Goes up when the code here changes what comes out."""


class Job(msgspec.Struct, frozen=True, eq=False):
    """One run."""

    task: str
    """What people call the task."""
    method: str
    kind: Kind
    definition: Definition
    seed: int
    episodes: int
    skill: NamedSkill | None = None
    """What a frozen job does, or a job that learns begins with."""
    taught_on: Definition | None = None
    """Where a controller is taught that is tried somewhere else."""

    @property
    def name(self) -> str:
        """What people call the job."""
        return f"{self.task}, {self.method}, seed {self.seed}"

    @property
    def cost(self) -> float:
        """About how many moves it takes."""
        return self.episodes * moves_expected(self.definition) * _COSTS.get(self.method, 1.0)


class Outcome(msgspec.Struct, frozen=True):
    """What came of a job; one entry an episode."""

    outcomes: str
    """One letter an episode: i(nserted), c(ollision), (no) p(rogress), m(ove limit)."""
    returns: list[float]
    force_n: list[float]
    """Mean over all moves of the episode, free ones included."""
    peak_n: list[float]
    moves: list[int]
    states: int
    """Contact states known at the end of a run that learnt, met by one that did not."""
    cpu_s: float
    digests: Digests | None = None
    """Of a run that learnt."""
    skill_sha256: str | None = None


class Done(msgspec.Struct, frozen=True):
    """What a process hands back: an outcome with what was learnt, or why there is none."""

    outcome: Outcome | None = None
    skill: bytes | None = None
    """Of a run that learnt, as a file holds it."""
    failure: str = ""
    trace: str = ""


class Order(msgspec.Struct, frozen=True):
    """A job, and the code that it is for."""

    job: Job
    code: str


def key(job: Job) -> dict[str, Any]:
    """Return all that the outcome of a job depends on."""
    taught_on = {} if job.taught_on is None else {"taught_on": definition_sha256(task_alone(job.taught_on))}
    return {
        **taught_on,
        "version": VERSION,
        "kind": job.kind,
        "controller": job.method if job.kind in WITHOUT_LEARNER else "",
        "definition": definition_sha256(_definition(job)),
        "seed": job.seed,
        "episodes": job.episodes,
        "skill": None if job.skill is None else job.skill.sha256,
        "code": code_of(job),
    }


def code_of(job: Job) -> str:
    """Return the digest of the code that decides what comes out of a job, as it is when a process first asks."""
    plugged = any(isinstance(part, Plugin) for part in (job.definition.classifier, job.definition.learner))
    return _codes()[job.kind, plugged and job.kind not in WITHOUT_LEARNER]


@cache
def _codes() -> dict[tuple[Kind, bool], str]:
    # All at once: files that somebody changes later are not what this process has loaded.
    return {
        (kind, plugged): code_sha256((*packages, *PLUGINS) if plugged else packages)
        for kind, packages in PACKAGES.items()
        for plugged in (False, True)
    }


def order(job: Job) -> Order:
    """Return what is handed to a process."""
    return Order(job, code_of(job))


def work(wanted: Order, tell: Tell) -> Done:
    """Do a job; whatever goes wrong in it is handed back, so that the others go on."""
    try:
        if code_of(wanted.job) != wanted.code:
            raise TreenailError(f"code: expected {wanted.code[:12]}, as who asks has, got {code_of(wanted.job)[:12]}")
        return _WORK[wanted.job.kind](wanted.job, tell)
    except TreenailError as error:
        return Done(failure=" ".join(str(error).split()), trace=traceback.format_exc())
    except Exception as error:  # a fault in a method is a fault of that method alone
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{place.filename.rpartition('/')[2]}:{place.lineno}"
        said = " ".join(f"{type(error).__name__}: {error}".split())
        return Done(failure=f"{said[:300]} ({where})", trace=traceback.format_exc())


def _definition(job: Job) -> Definition:
    """Return what a job reads of its definition: who does not learn is the same beside any learner's settings."""
    return task_alone(job.definition) if job.kind in WITHOUT_LEARNER else job.definition


def _learn(job: Job, tell: Tell) -> Done:
    began_s = time.process_time()
    run = run_seed(job.definition, job.seed, job.episodes, tell, job.skill)
    episodes, digests = run.result.episodes, run.result.digests
    made = outcome(episodes, cpu_s=time.process_time() - began_s)
    whole = msgspec.structs.replace(made, digests=digests, skill_sha256=run.skill.sha256)
    return Done(whole, file_bytes(run.skill))


def _play(job: Job, tell: Tell) -> Done:
    if job.method not in (*BASELINES, PUSH):
        raise TreenailError(f"controller: expected one of {', '.join((*BASELINES, PUSH))}, got {job.method}")
    began_s, definition = time.process_time(), _definition(job)
    done = trial(definition, Controlled(job.method).controller(definition, job.seed), job.seed, job.episodes, tell)
    return Done(outcome(done.episodes, len(done.states), time.process_time() - began_s))


def _taught(job: Job, tell: Tell) -> Done:
    if job.method not in TAUGHT:
        raise TreenailError(f"controller: expected one of {', '.join(TAUGHT)}, got {job.method}")
    began_s, definition = time.process_time(), _definition(job)
    controller = TAUGHT[job.method](task_alone(job.taught_on or definition), job.seed)
    done = trial(definition, controller, job.seed, job.episodes, tell)
    return Done(outcome(done.episodes, len(done.states), time.process_time() - began_s))


def _frozen(job: Job, tell: Tell) -> Done:
    assert job.skill is not None
    began_s, definition = time.process_time(), job.definition
    done = trial(definition, FrozenSkill(job.skill, definition, job.seed), job.seed, job.episodes, tell)
    return Done(outcome(done.episodes, len(done.states), time.process_time() - began_s))


def _oracle(job: Job, tell: Tell) -> Done:
    """Search the insertion of least force from the start of the seed's first episode, noise off."""
    began_s, replace = time.process_time(), msgspec.structs.replace
    home = Insertion(job.definition, "", job.seed).home(0, 0)
    start = replace(
        job.definition.start,
        **{name: getattr(home, name) for name in ("x_mm", "y_mm", "rx_deg", "ry_deg", "rz_deg")},
        **dict.fromkeys(SPREADS, 0.0),
    )
    rx_deg, ry_deg = tilt_deg(job.definition.hole, job.seed, 0)
    hole = replace(job.definition.hole, rx_deg=rx_deg, ry_deg=ry_deg, tilt_spread_deg=0.0)
    still = replace(_definition(job), start=start, hole=hole, noise=replace(job.definition.noise, scale=0.0))
    effort = SLOW_ORACLE if moves_expected(still) > SLOW_MOVES else ORACLE
    front = search(still, effort, lambda _stage, _done, _most: None)
    if not front:
        raise TreenailError("oracle: expected an insertion, found none")
    tell(1)
    least = min(front, key=lambda attempt: attempt.summary.mean_force_n)
    return Done(outcome([least.summary], 0, time.process_time() - began_s))


def outcome(episodes: Sequence[EpisodeSummary], states: int | None = None, cpu_s: float = 0.0) -> Outcome:
    """Return what came of some episodes, at least one; without ``states`` those that the last of them knew."""
    return Outcome(
        outcomes="".join(LETTERS[summary.outcome] for summary in episodes),
        returns=[summary.episode_return for summary in episodes],
        force_n=[summary.mean_force_n for summary in episodes],
        peak_n=[summary.peak_force_n for summary in episodes],
        moves=[summary.moves for summary in episodes],
        states=episodes[-1].states if states is None else states,
        cpu_s=cpu_s,
    )


_WORK = {"learn": _learn, "play": _play, "frozen": _frozen, "oracle": _oracle, "taught": _taught}
