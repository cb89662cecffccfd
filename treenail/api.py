"""What a Python program does with Treenail: load an experiment, run it over seeds, read and write what was learnt."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from experiments.lab import pool, result_files
from experiments.lab import run as runs_of
from services.rules import plugins, results
from services.rules import skill as skill_file
from services.rules.results import Digests, RunResult, RunSummary, Summary, Wanted
from services.rules.shipped_skill import for_task, named_or_file
from services.rules.swaps import planned
from services.wire import definition_file
from services.wire.definition import Definition as Definition
from services.wire.errors import TreenailError as TreenailError
from services.wire.messages import EpisodeSummary as EpisodeSummary
from services.wire.messages import Swap

Setting = str | bool | int | float
"""A value in a definition."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, or SIGTERM, during ``run``; ``results`` are what had been run by then."""

    def __init__(self, results: Results) -> None:
        super().__init__()
        self.results = results


@dataclass(frozen=True)
class Skill:
    """What a run had learnt: the agent's Q-table and the classifier's contact states."""

    _named: skill_file.NamedSkill

    @property
    def sha256(self) -> str:
        """Its name: the SHA-256, in hex, of its bytes."""
        return self._named.sha256

    @property
    def definition(self) -> Definition:
        """The experiment that it was learnt in."""
        return self._named.skill.definition

    @property
    def seed(self) -> int:
        """Seed of the run that it was learnt in."""
        return self._named.skill.seed

    @property
    def episodes(self) -> int:
        """Episodes that it was learnt in, with those of the skill that the run began with."""
        return self._named.skill.episodes

    @property
    def states(self) -> int:
        """Contact states that it tells apart."""
        return self._named.states

    @property
    def actions(self) -> tuple[str, ...]:
        """Names of the actions, such as ``+X``."""
        return tuple(self._named.skill.actions)

    def write(self, path: str | Path, *, force: bool = False) -> None:
        """Write it into a file, as ``treenail checkpoint export`` does.

        Raises TreenailError when that cannot be done, or when there is such a file and ``force`` is not set.
        """
        skill_file.write(Path(path), self._named, force=force)


@dataclass(frozen=True)
class Run:
    """The run of one seed."""

    seed: int
    episodes: tuple[EpisodeSummary, ...]
    """One record an episode, in order: return, moves, forces [N], torques [N m], outcome."""
    summary: RunSummary
    """The run in figures, as in ``summary.json``: steady state, first ten episodes, last quarter; a dictionary."""
    skill: Skill
    """What it had learnt at its end."""
    seconds: float
    """How long it took [s]; the only thing here that another run does not repeat."""

    @property
    def digests(self) -> Digests:
        """SHA-256 in hex of ``q_table``, ``art2`` and ``episodes``: equal for equal runs, wherever they were run."""
        return self.summary["digests"]


@dataclass(frozen=True)
class Results:
    """The runs of several seeds, in ascending order."""

    definition: Definition
    runs: tuple[Run, ...]
    swaps: tuple[Swap, ...] = ()
    """Changes of learner or classifier on the way."""
    interrupted: Wanted | None = None
    """What should have been run, where Ctrl-C came before; None when all was."""

    @property
    def summary(self) -> Summary:
        """What ``summary.json`` says, as a dictionary."""
        sha256 = definition_file.definition_sha256(self.definition)
        told = results.summary(self.definition, sha256, self._results(), self.swaps)
        if self.interrupted is not None:
            told["interrupted"] = self.interrupted
        return told

    def table(self) -> list[dict[str, str | int | float]]:
        """Return one row a seed and episode, ready for ``pandas.DataFrame``; columns as in ``episodes.csv``.

        ``seed``, ``episode``, ``outcome``, ``return``, ``moves``, ``decisions``, ``mean_force_n``, ``peak_force_n``,
        ``mean_torque_nm``, ``peak_torque_nm``, ``states``: units are in the names, N and N m.
        """
        return list(result_files.rows_of(self._results()))

    def write(self, folder: str | Path, *, force: bool = False) -> None:
        """Write what ``treenail experiment run`` writes: summary, episodes, figures, skills. Needs the extra cli.

        Raises TreenailError when that cannot be done, or when the folder has results of another definition and
        ``force`` is not set.
        """
        from experiments.lab import plots

        told, path = self.summary, Path(folder)
        result_files.prepare(path, told["definition_sha256"], force)
        figures = plots.figures(
            self.definition.name, result_files.in_step({one.seed: one.episodes for one in self.runs})
        )
        learnt = {one.seed: one.skill._named for one in self.runs}
        result_files.write(path, self.definition, told, self._results(), figures, learnt)

    def _results(self) -> list[RunResult]:
        return [RunResult(one.seed, one.episodes, one.digests) for one in self.runs]


def shipped() -> tuple[str, ...]:
    """Return the names of the experiments that come with Treenail."""
    return tuple(definition_file.shipped())


def load(
    name_or_path: str | Path, changes: Mapping[str, Setting] | Iterable[str] = (), **top_level: Setting
) -> Definition:
    """Return the definition of a shipped experiment or of a TOML file, checked.

    ``changes`` are settings by dotted key, ``{"learner.alpha": 0.1}``, or texts as after ``--set``,
    ``["learner.alpha=0.1"]``; keyword arguments change keys at the top, ``episodes=100``. Raises TreenailError that
    says where, what was expected and what came.
    """
    texts = [_text(key, value) for key, value in changes.items()] if isinstance(changes, Mapping) else list(changes)
    texts += [_text(key, value) for key, value in top_level.items()]
    return definition_file.load(str(name_or_path), texts)


def run(
    definition: Definition | str | Path,
    *,
    seeds: int | Iterable[int] = 1,
    episodes: int | None = None,
    skill: Skill | str | Path | None = None,
    swaps: Sequence[str] = (),
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Results:
    """Run an experiment, every seed in a process of its own, and return what came of it.

    Args:
        definition: What to run: a definition, or what ``load`` takes.
        seeds: How many, from seed 0 on, or which.
        episodes: Length of each run; None for the definition's.
        skill: What each run begins with: a skill, a file with one, or ``"builtin"``, the one that comes with Treenail,
            which is given the experiment's moves; None for nothing.
        swaps: Changes of learner or classifier on the way, as after ``--swap``.
        jobs: Seeds run at a time; None for one a core.
        progress: Called now and then with a seed and how many of its episodes are over.

    The same definition, seed, length, skill and swaps give the same bytes, here, in ``treenail experiment run`` and in
    a cell of many processes. A script needs no ``if __name__ == "__main__"``: the processes do not run it again.
    Raises TreenailError, which names the seed, when one fails, and Interrupted upon Ctrl-C.
    """
    experiment = definition if isinstance(definition, Definition) else load(definition)
    plugins.check(experiment)
    length = experiment.episodes if episodes is None else episodes
    chosen = list(range(seeds)) if isinstance(seeds, int) else sorted(seeds)
    if not chosen or len(set(chosen)) != len(chosen):
        raise TreenailError(f"seeds: expected one or more, each once, got {seeds!r}")
    for seed in chosen:
        definition_file.check_run(seed, length)
    if jobs is not None and jobs < 1:
        raise TreenailError(f"jobs: expected 1 or more, got {jobs}")
    begin_with = None
    if skill is not None:
        begin_with = for_task(skill._named if isinstance(skill, Skill) else named_or_file(skill), experiment)
    made = tuple(planned("", experiment, swaps, length))
    at_a_time, listener = jobs or pool.usable_cores(), _Progress(progress)
    try:
        timed = runs_of.run_seeds(experiment, chosen, length, at_a_time, listener, begin_with, made)
    except runs_of.Interrupted as stopped:
        some = tuple(map(_run_of, stopped.runs))
        raise Interrupted(Results(experiment, some, made, {"seeds": chosen, "episodes": length})) from None
    return Results(experiment, tuple(map(_run_of, timed)), made)


def read_skill(path: str | Path) -> Skill:
    """Return the skill in a file, or for ``"builtin"`` the one that comes with Treenail.

    Raises TreenailError when it cannot be read, is damaged, or is of another contract.
    """
    return Skill(named_or_file(path))


class _Progress:
    """Passes on how far runs are."""

    def __init__(self, tell: Callable[[int, int], None] | None) -> None:
        self._tell = tell

    def started(self, seed: int) -> None:
        """Hear that a run begins."""

    def advanced(self, seed: int, episodes: int) -> None:
        """Pass on how far a run is."""
        if self._tell is not None:
            self._tell(seed, episodes)

    def finished(self, seed: int) -> None:
        """Hear that a run is over."""


def _run_of(timed: runs_of.TimedRun) -> Run:
    result = timed.result
    return Run(result.seed, result.episodes, results.run_summary(result), Skill(timed.skill), timed.seconds)


def _text(key: str, value: Setting) -> str:
    """Return a setting as after ``--set``. Raises TreenailError."""
    if isinstance(value, bool):
        return f"{key}={'true' if value else 'false'}"
    if isinstance(value, str):
        return f"{key}={json.dumps(value, ensure_ascii=False)}"
    if isinstance(value, int):
        return f"{key}={int(value)}"
    try:
        return f"{key}={float(value)!r}"
    except (TypeError, ValueError):
        raise TreenailError(f"{key}: expected text, a number, True or False, got {value!r}") from None
