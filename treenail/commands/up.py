"""``treenail up``: a whole cell on this machine, supervised, to the end of its run."""

from __future__ import annotations

import argparse
import os
import queue
import shlex
import shutil
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

from experiments.lab.result_files import prepare
from services.bus.session import DEFAULT_ENDPOINT
from services.bus.stop_flag import STOP_SIGNALS, StopFlag
from services.cell.client import Client
from services.cell.ended import EndedRun
from services.cell.local import LocalCell
from services.cell.plan import Plan
from services.cell.skill_transfer import beginning
from services.rules.command_line import EXIT_INTERRUPTED
from services.rules.progress import Progress
from services.rules.swaps import words
from services.wire.definition_file import definition_sha256, shipped
from services.wire.errors import ContractError, NoAnswerError, RefusedError, TreenailError
from services.wire.keys import ALIVE, EPISODE, EXPERIMENT, OPERATOR, wild
from services.wire.messages import Alive, EpisodeSummary, Experiment
from treenail.commands.progress import STARTING, WAITING, Reporter, because
from treenail.commands.up_options import USUAL, add_arguments, plan_of

__all__ = ["act", "add_arguments"]

POLL_S = 0.5


def act(arguments: argparse.Namespace) -> int:
    """Bring a cell up, watch it to the end of its run, write the results; return the exit status."""
    plan = plan_of(arguments)
    interrupted, ended = StopFlag(signal.SIGINT), StopFlag(signal.SIGTERM)
    prepare(plan.out, definition_sha256(plan.definition), force=True)
    progress = Progress(plan.episodes)
    title = f"{plan.definition.name}, seed {plan.seed}"

    def mind() -> None:
        if interrupted or ended:
            raise KeyboardInterrupt

    with Reporter(progress, title, plan.viewer.url if plan.viewer else "") as reporter:
        with LocalCell(plan, reporter.say, also_mind=mind) as cell:
            try:
                _say_what_is_started(plan, len(arguments.set), reporter)
                cell.start()
                _run(cell, reporter, progress, ended, stay=arguments.stay)
                return 0
            except KeyboardInterrupt:
                pass
            finally:
                for name in cell.stop():
                    reporter.say(f"{name} did not stop in time and was killed")
        reporter.end_live()
        reporter.say(f"stopped at episode {progress.done}; the same command goes on from there: {_same_command()}")
        return EXIT_INTERRUPTED


def _run(cell: LocalCell, reporter: Reporter, progress: Progress, hurried: StopFlag, *, stay: bool) -> None:
    """Watch a cell to the end of its run and tell what came of it.

    Raises KeyboardInterrupt, having told the results so far unless ``hurried``.
    """
    watched = Watched(cell, reporter, progress)
    with cell.client() as client:
        try:
            watched.to_the_end(client)
        except KeyboardInterrupt:
            if not hurried:
                _tell_results_so_far(cell, watched, client, reporter)
            raise
        _tell_results(cell, watched.ended, client, reporter)
        if stay:
            _stay(cell, reporter)
        else:
            reporter.say(f"to ask the cell itself, let it stay: {_same_command()} --stay")
            _say_what_is_left(cell.plan, reporter)


class Watched:
    """The run that a cell works on, as far as its task has told."""

    def __init__(self, cell: LocalCell, reporter: Reporter, progress: Progress) -> None:
        self.run = cell.plan.run
        self.experiment: Experiment | None = None
        """What the task said last; None before it said anything."""
        self._cell = cell
        self._reporter = reporter
        self._progress = progress
        self._first: int | None = None
        """Number of the first episode that was seen to finish."""
        self._others: list[Alive] = []
        """What the services say of themselves while the task waits."""

    @property
    def phase(self) -> str:
        """Return what the task does."""
        return STARTING if self.experiment is None else self.experiment.phase

    @property
    def phase_in_full(self) -> str:
        """Return what the task does, and of what it waits for why."""
        return because(self.phase, self._others)

    @property
    def ended(self) -> EndedRun:
        """Return the run as what has ended, or would if it ended now."""
        plan, experiment = self._cell.plan, self.experiment
        swaps = () if experiment is None else experiment.swaps
        first_version = 0 if experiment is None else experiment.first_policy_version
        return EndedRun(self.run, plan.definition, plan.seed, self._progress.done, first_version, swaps)

    def to_the_end(self, client: Client) -> None:
        """Watch the run until it is finished. Raises what ``mind`` of the cell raises."""
        arrived: queue.SimpleQueue[EpisodeSummary] = queue.SimpleQueue()
        client.subscribe(EPISODE, EpisodeSummary, arrived.put)
        next_poll = 0.0
        while self.phase != "finished":
            self._cell.mind()
            self._drain(arrived)
            if time.monotonic() >= next_poll:
                next_poll = time.monotonic() + POLL_S
                if (experiment := _experiment(client)) is not None:
                    self._note(experiment)
                    waits = self.phase.startswith(WAITING)
                    self._others = others(client) if waits else []
            self._reporter.show(self._cell.supervisor.alive(), self.phase_in_full)
        self._drain(arrived)
        self._reporter.show(self._cell.supervisor.alive(), self.phase, now=True)

    def _note(self, now: Experiment) -> None:
        """Note what the task says, and tell what is new in it."""
        before, say, progress = self.experiment, self._reporter.say, self._progress
        if now.run != self.run:
            self.run, before = now.run, None
            progress.done = 0
            progress.recent.clear()
            say(f"the store says what to begin with: {beginning(now)}")
        elif before is None and (begun := now.episodes_done if self._first is None else self._first):
            at_end = "the run was finished already; --fresh begins it anew"
            say(f"resuming from episode {begun}" if begun < now.episodes else at_end)
        for swap in now.swaps[0 if before is None else len(before.swaps) :]:
            say(f"swap {words(swap)}")
        self.experiment = now
        progress.done = max(progress.done, now.episodes_done)
        progress.episodes = max(self._cell.plan.episodes, now.episodes_done)

    def _drain(self, arrived: queue.SimpleQueue[EpisodeSummary]) -> None:
        """Count the episodes that have arrived, waiting a moment for the first one."""
        try:
            summary = arrived.get(timeout=0.1)
            while True:
                if summary.run == self.run:
                    self._first = summary.episode if self._first is None else self._first
                    self._progress.add(summary)
                summary = arrived.get_nowait()
        except queue.Empty:
            return


def others(client: Client) -> list[Alive]:
    """Return what the services say of themselves; one that is too busy with starting to answer is left out."""
    samples, _ = client.replies(wild(ALIVE), POLL_S)
    try:
        return [client.message(sample, Alive) for sample in samples]
    except ContractError:
        return []  # the task will say so, or who started that service


def _experiment(client: Client) -> Experiment | None:
    try:
        return client.ask(EXPERIMENT, Experiment, timeout_s=0.5)
    except (NoAnswerError, RefusedError, ContractError):
        return None  # the task is starting, or being started again


def _say_what_is_started(plan: Plan, given: int, reporter: Reporter) -> None:
    """Say where the run is, what was set beside the ``given`` overrides, and where it can be watched."""
    reporter.say(f"run {plan.run} in {plan.out}; logs in {plan.logs}")
    if added := plan.overrides[given:]:
        reporter.say(
            f"the sensor is read in counts, and what else this hardware asks for: --set {' --set '.join(added)}"
        )
    if plan.hardware is not None and not plan.hardware.emulated:
        reporter.say("nothing moves before `treenail resume`; what holds the arm: `treenail resume --look`")
    if plan.viewer is not None:
        reporter.say(f"watch it live: rerun {plan.viewer.url} ({plan.viewer.for_whom})")
    if plan.viewer is not None and plan.viewer.page is not None:
        reporter.say(f"or in a browser: {plan.viewer.page}")


def _tell_results(cell: LocalCell, run: EndedRun, client: Client, reporter: Reporter) -> None:
    """Write the results of a finished run, and show them where they stay on the screen."""
    # Figures and compiled kernels are loaded when they are needed: the cell would only start later.
    from treenail.commands.finish import FILES, finish, results_line, results_table

    plan = cell.plan
    finished = finish(client, run, plan.out, cell.mind)
    reporter.end_live()
    reporter.print(results_table(finished.summary, plan.definition.name))
    reporter.say(results_line(finished.summary))
    reporter.say(f"results in {plan.out}: {FILES}")
    if finished.skill is None:
        reporter.say(f"what was learnt is in {plan.out / 'store.sqlite'} alone: {finished.trouble}")
        return
    reporter.say(f"what was learnt: {_command('checkpoint', 'show', str(finished.skill))}")
    again = _command("up", "sim", *_experiment_words(plan.experiment), "--skill", str(finished.skill))
    reporter.say(f"begin another run with it: {again}")


def _experiment_words(definition: Path) -> tuple[str, ...]:
    """Return how to ask for a definition's file; nothing for the one that is learnt where nothing is said."""
    name = definition.stem if shipped().get(definition.stem) == definition else str(definition)
    return () if name == USUAL else ("--experiment", name)


def _tell_results_so_far(cell: LocalCell, watched: Watched, client: Client, reporter: Reporter) -> None:
    """Do the same for a run under way, whose task and so whose robot stops at once; Ctrl-C again leaves it out."""
    cell.stop_task()
    reporter.end_live()
    if watched.experiment is None or watched.experiment.episodes_done == 0:
        return
    _on_stop(signal.default_int_handler)
    reporter.say("writing the results so far; Ctrl-C again leaves them out")
    from treenail.commands.finish import FILES, finish_early, results_line, results_table

    try:
        finished = finish_early(client, watched.ended, cell.plan.episodes, cell.plan.out)
    except TreenailError as error:
        reporter.say(f"no results so far: {error}")
        return
    finally:
        _on_stop(signal.SIG_IGN)  # what follows, stopping the processes, takes two seconds at most
    if finished is not None:
        reporter.print(results_table(finished.summary, cell.plan.definition.name))
        reporter.say(results_line(finished.summary))
        reporter.say(f"results so far in {cell.plan.out}: {FILES}, {finished.skill and finished.skill.name}")


def _on_stop(handler: Callable[[int, FrameType | None], Any] | signal.Handlers) -> None:
    for number in STOP_SIGNALS:
        signal.signal(number, handler)


def _stay(cell: LocalCell, reporter: Reporter) -> None:
    """Keep a finished cell for questions until Ctrl-C, and say how to ask."""
    plan = cell.plan
    where = [] if plan.endpoint == DEFAULT_ENDPOINT else ["--connect", plan.endpoint]
    where += [] if plan.cell == "a" else ["--cell", plan.cell]
    where += [] if plan.certs is None else ["--certs", str(plan.certs / OPERATOR)]
    reporter.say(f"the cell stays for questions until Ctrl-C: {_command('q-table', *where)}")
    for question in (("policy", "--state", "0"), ("status",), ("checkpoint", "export", "FILE")):
        reporter.say(f"or {_command(*question, *where)}")
    try:
        while True:
            cell.mind()
            time.sleep(POLL_S)
    except KeyboardInterrupt:
        _say_what_is_left(plan, reporter)


def _say_what_is_left(plan: Plan, reporter: Reporter) -> None:
    """Say what can be asked of the run when its cell is gone, and how."""
    folder = str(plan.out)
    reporter.say(f"without the cell, from what it left: {_command('checkpoint', 'list', '--store', folder)}")
    for question in (
        ("replay", "--store", folder),
        ("export", folder, "--to", "parquet"),
        ("video", folder, "OUT.gif"),
    ):
        reporter.say(f"or {_command(*question)}")


def _command(*words: str) -> str:
    """Return a command line that runs this installation."""
    called = Path(sys.argv[0])
    elsewhere = called.name == "treenail" and shutil.which("treenail") != str(called)
    return shlex.join([os.path.relpath(called) if elsewhere else "treenail", *words])


def _same_command() -> str:
    """Return the command that goes on with the run: ours, but for forgetting it."""
    return _command(*(word for word in sys.argv[1:] if word != "--fresh"))
