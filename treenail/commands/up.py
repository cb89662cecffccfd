"""``treenail up``: a whole cell on this machine, supervised, to the end of its run."""

from __future__ import annotations

import argparse
import fcntl
import queue
import time
from collections.abc import Callable

from experiments.lab.result_files import prepare
from services.bus.stop_flag import StopFlag
from services.cell import plan as plans
from services.cell.client import Client
from services.cell.ended import EndedRun
from services.cell.plan import Plan, plan_of
from services.cell.skill_transfer import beginning
from services.cell.start import client_of, start_services
from services.cell.supervisor import Supervisor
from services.rules.progress import Progress
from services.rules.swaps import words
from services.wire.definition_file import definition_sha256
from services.wire.errors import CellError, ContractError, NoAnswerError, RefusedError
from services.wire.keys import EPISODE, EXPERIMENT
from services.wire.messages import EpisodeSummary, Experiment, Swap
from treenail.commands.finish import finish
from treenail.commands.progress import Reporter

EXIT_INTERRUPTED = 130
POLL_S = 0.5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``treenail up``."""
    plans.add_arguments(parser)


def act(arguments: argparse.Namespace) -> int:
    """Bring a cell up, watch it to the end of its run, write the results; return the exit status."""
    plan = plan_of(arguments)
    stop = StopFlag()
    _prepare(plan)
    progress = Progress(plan.episodes)
    title = f"{plan.definition.name}, seed {arguments.seed}"
    with Reporter(progress, title, plan.viewer.url if plan.viewer else "") as reporter:
        supervisor = Supervisor(plan.out / "logs", reporter.say, certs=arguments.certs)

        def mind() -> None:
            supervisor.check()
            if stop:
                raise KeyboardInterrupt

        try:
            _run(plan, supervisor, reporter, progress, mind)
            return 0
        except KeyboardInterrupt:
            reporter.say(f"stopped at episode {progress.done}; the same command goes on from there")
            return EXIT_INTERRUPTED
        finally:
            _stop(supervisor, reporter)


def _prepare(plan: Plan) -> None:
    """Make the run directory ready. Raises TreenailError when it cannot be written to, or another cell works in it."""
    prepare(plan.out, definition_sha256(plan.definition), force=True)
    lock = plan.out / "store.sqlite.lock"
    try:
        (plan.out / "logs").mkdir(exist_ok=True)
        with lock.open("ab") as held:
            # The store takes this lock too; asked here, it is a clear answer before anything starts.
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            stale = plan.out.glob("store.sqlite*") if plan.arguments.fresh else ()
            for path in stale:
                if path != lock:
                    path.unlink()
    except BlockingIOError:
        raise CellError(f"--out {plan.out}: another cell is working in this directory") from None
    except OSError as error:
        raise CellError(f"--out {plan.out}: cannot hold a run: {error.strerror}") from error


def _run(plan: Plan, supervisor: Supervisor, reporter: Reporter, progress: Progress, mind: Callable[[], None]) -> None:
    reporter.say(f"run {plan.run} in {plan.out}; logs in {plan.out / 'logs'}")
    if added := plan.overrides[len(plan.arguments.set) :]:
        reporter.say(f"the sensor is read in counts, as a receiver card gives them: --set {' --set '.join(added)}")
    if plan.viewer is not None:
        reporter.say(f"watch it live: rerun {plan.viewer.url}")
    if plan.viewer is not None and plan.viewer.page is not None:
        reporter.say(f"or in a browser: {plan.viewer.page}")
    start_services(plan, supervisor, mind)
    with client_of(plan, mind) as client:
        arrived: queue.SimpleQueue[EpisodeSummary] = queue.SimpleQueue()
        client.subscribe(EPISODE, EpisodeSummary, arrived.put)
        phase, run, first_version = "starting", plan.run, 0
        swaps: tuple[Swap, ...] = ()
        next_poll = 0.0
        while phase != "finished":
            mind()
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
            reporter.show(supervisor.alive(), phase)
        _drain(arrived, progress, run)
        reporter.show(supervisor.alive(), phase, now=True)
        ended = EndedRun(run, plan.definition, plan.arguments.seed, progress.done, first_version, swaps)
        finish(client, ended, plan.out, mind, reporter.say)


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


def _stop(supervisor: Supervisor, reporter: Reporter) -> None:
    for name in supervisor.stop():
        reporter.say(f"{name} did not stop in time and was killed")
