"""``treenail up``: a whole cell on this machine, supervised, to the end of its run."""

from __future__ import annotations

import argparse
import queue
import time

from experiments.lab.result_files import prepare
from services.bus.stop_flag import StopFlag
from services.cell.client import Client
from services.cell.ended import EndedRun
from services.cell.local import LocalCell
from services.cell.plan import Plan
from services.cell.skill_transfer import beginning
from services.rules.progress import Progress
from services.rules.swaps import words
from services.wire.definition_file import definition_sha256
from services.wire.errors import ContractError, NoAnswerError, RefusedError
from services.wire.keys import EPISODE, EXPERIMENT
from services.wire.messages import EpisodeSummary, Experiment, Swap
from treenail.commands.finish import finish
from treenail.commands.progress import Reporter
from treenail.commands.up_options import add_arguments, plan_of

__all__ = ["act", "add_arguments"]

EXIT_INTERRUPTED = 130
POLL_S = 0.5


def act(arguments: argparse.Namespace) -> int:
    """Bring a cell up, watch it to the end of its run, write the results; return the exit status."""
    plan = plan_of(arguments)
    stop = StopFlag()
    prepare(plan.out, definition_sha256(plan.definition), force=True)
    progress = Progress(plan.episodes)
    title = f"{plan.definition.name}, seed {plan.seed}"

    def mind() -> None:
        if stop:
            raise KeyboardInterrupt

    with Reporter(progress, title, plan.viewer.url if plan.viewer else "") as reporter:
        cell = LocalCell(plan, reporter.say, also_mind=mind)
        with cell:
            try:
                _say_what_is_started(plan, len(arguments.set), reporter)
                cell.start()
                _watch(cell, reporter, progress)
                return 0
            except KeyboardInterrupt:
                reporter.say(f"stopped at episode {progress.done}; the same command goes on from there")
                return EXIT_INTERRUPTED
            finally:
                for name in cell.stop():
                    reporter.say(f"{name} did not stop in time and was killed")


def _say_what_is_started(plan: Plan, given: int, reporter: Reporter) -> None:
    """Say where the run is, what was set beside the ``given`` overrides, and where it can be watched."""
    reporter.say(f"run {plan.run} in {plan.out}; logs in {plan.logs}")
    if added := plan.overrides[given:]:
        reporter.say(f"the sensor is read in counts, as a receiver card gives them: --set {' --set '.join(added)}")
    if plan.viewer is not None:
        reporter.say(f"watch it live: rerun {plan.viewer.url} ({plan.viewer.for_whom})")
    if plan.viewer is not None and plan.viewer.page is not None:
        reporter.say(f"or in a browser: {plan.viewer.page}")


def _watch(cell: LocalCell, reporter: Reporter, progress: Progress) -> None:
    """Watch a cell to the end of its run, and write its results."""
    plan = cell.plan
    with cell.client() as client:
        arrived: queue.SimpleQueue[EpisodeSummary] = queue.SimpleQueue()
        client.subscribe(EPISODE, EpisodeSummary, arrived.put)
        phase, run, first_version = "starting", plan.run, 0
        swaps: tuple[Swap, ...] = ()
        next_poll = 0.0
        while phase != "finished":
            cell.mind()
            _drain(arrived, progress, run)
            if time.monotonic() >= next_poll:
                next_poll = time.monotonic() + POLL_S
                experiment = _experiment(client)
                if experiment is not None:
                    if experiment.run != run:
                        run, swaps = experiment.run, ()
                        progress.done = 0
                        progress.recent.clear()
                        reporter.say(f"the store says what to begin with: {beginning(experiment)}")
                    for swap in experiment.swaps[len(swaps) :]:
                        reporter.say(f"swap {words(swap)}")
                    phase, first_version = experiment.phase, experiment.first_policy_version
                    swaps = experiment.swaps
                    progress.done = max(progress.done, experiment.episodes_done)
                    progress.episodes = max(plan.episodes, experiment.episodes_done)
            reporter.show(cell.supervisor.alive(), phase)
        _drain(arrived, progress, run)
        reporter.show(cell.supervisor.alive(), phase, now=True)
        ended = EndedRun(run, plan.definition, plan.seed, progress.done, first_version, swaps)
        finish(client, ended, plan.out, cell.mind, reporter.say)


def _experiment(client: Client) -> Experiment | None:
    try:
        return client.ask(EXPERIMENT, Experiment, timeout_s=0.5)
    except (NoAnswerError, RefusedError, ContractError):
        return None  # the task is starting, or being started again


def _drain(arrived: queue.SimpleQueue[EpisodeSummary], progress: Progress, run: str) -> None:
    """Count the episodes that have arrived, waiting a moment for the first one."""
    try:
        summary = arrived.get(timeout=0.1)
        while True:
            if summary.run == run:
                progress.add(summary)
            summary = arrived.get_nowait()
    except queue.Empty:
        return
