"""``treenail up``: a whole cell on this machine, supervised, to the end of its run."""

from __future__ import annotations

import argparse
import fcntl
import queue
import signal
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from experiments.result_files import prepare
from services.cli.client import Client
from services.cli.finish import finish
from services.cli.progress import Reporter
from services.cli.supervisor import Supervisor
from services.wire.definition import Definition
from services.wire.definition_file import check_run, definition_sha256, find, load, run_id
from services.wire.errors import CellError, ContractError, NoAnswerError, RefusedError
from services.wire.keys import EPISODE, EXPERIMENT, Keys
from services.wire.messages import EpisodeSummary, Experiment
from services.wire.progress import Progress
from services.wire.service import Options

PROFILES = ("sim",)
EXIT_INTERRUPTED = 130
POLL_S = 0.5


@dataclass(frozen=True)
class Plan:
    """What to bring up, checked before anything starts."""

    arguments: argparse.Namespace
    definition: Definition
    run: str
    episodes: int
    out: Path
    endpoint: str
    viewer_url: str


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``treenail up``."""
    parser.add_argument("profile", choices=PROFILES, help="sim: the simulator in place of robot and sensor")
    parser.add_argument("--experiment", default="chamfered-q-softmax", help="name or TOML file of the definition")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="override a key of it")
    parser.add_argument("--episodes", type=int, help="length of the run (default: the definition's)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the run, from 0 (default: 0)")
    parser.add_argument("--out", type=Path, help="run directory (default: runs/<experiment>-<hash>-s<seed>)")
    parser.add_argument("--fresh", action="store_true", help="forget what the run directory knows of earlier runs")
    parser.add_argument("--cell", default="a", help="name of the cell (default: a)")
    parser.add_argument("--port", type=int, default=7447, help="the router's port on 127.0.0.1, 0 for a free one")
    parser.add_argument("--viewer-port", type=int, default=9876, help="port for Rerun viewers, 0 for a free one")
    parser.add_argument("--viewer-bind", default="0.0.0.0", help="address for Rerun viewers (default: all)")
    parser.add_argument("--no-viewer", action="store_true", help="run without the viewer service")
    parser.add_argument("--save", type=Path, metavar="FILE.rrd", help="let the viewer service record as well")


def act(arguments: argparse.Namespace) -> int:
    """Bring a cell up, watch it to the end of its run, write the results; return the exit status."""
    plan = _plan(arguments)
    stop = _StopFlag()
    _prepare(plan)
    progress = Progress(plan.episodes)
    title = f"{plan.definition.name}, seed {arguments.seed}"
    with Reporter(progress, title, plan.viewer_url) as reporter:
        supervisor = Supervisor(plan.out / "logs", reporter.say)

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


def _plan(arguments: argparse.Namespace) -> Plan:
    definition = load(arguments.experiment, arguments.set)
    episodes = definition.episodes if arguments.episodes is None else arguments.episodes
    check_run(arguments.seed, episodes)
    Keys(arguments.cell)
    run = run_id(definition, arguments.seed)
    out = arguments.out or Path("runs") / f"{definition.name}-{definition_sha256(definition)[:8]}-s{arguments.seed}"
    port = _free_port("127.0.0.1", arguments.port, "--port")
    viewer_url = ""
    if not arguments.no_viewer:
        arguments.viewer_port = _free_port(arguments.viewer_bind, arguments.viewer_port, "--viewer-port")
        host = socket.gethostname() if arguments.viewer_bind == "0.0.0.0" else arguments.viewer_bind
        viewer_url = f"rerun+http://{host}:{arguments.viewer_port}/proxy"
    return Plan(arguments, definition, run, episodes, out, f"tcp/127.0.0.1:{port}", viewer_url)


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


def _free_port(host: str, port: int, option: str) -> int:
    """Return ``port``, or a free one for 0. Raises CellError when it is taken."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except (OSError, OverflowError) as error:
            raise CellError(f"{option} {port}: cannot listen on {host}:{port}: {error}; try another, or 0") from None
        return int(probe.getsockname()[1])


def _start(plan: Plan, supervisor: Supervisor) -> None:
    arguments = plan.arguments
    cell = ("--cell", arguments.cell, "--connect", plan.endpoint)
    experiment = find(arguments.experiment)
    overrides = [word for item in arguments.set for word in ("--set", item)]
    length = ("--seed", str(arguments.seed), "--episodes", str(plan.episodes))
    supervisor.start("router", "--listen", plan.endpoint)
    supervisor.start("store", *cell, "--file", str(plan.out / "store.sqlite"))
    supervisor.start("task", *cell, "--experiment", str(experiment.resolve()), *overrides, *length)
    for name in ("sim", "classifier", "agent"):
        supervisor.start(name, *cell)
    if not arguments.no_viewer:
        save = () if arguments.save is None else ("--save", str(arguments.save))
        serve = ("--bind", arguments.viewer_bind, "--port", str(arguments.viewer_port))
        supervisor.start("viewer", *cell, *serve, *save)


def _run(plan: Plan, supervisor: Supervisor, reporter: Reporter, progress: Progress, mind: Callable[[], None]) -> None:
    reporter.say(f"run {plan.run} in {plan.out}; logs in {plan.out / 'logs'}")
    if plan.viewer_url:
        reporter.say(f"watch it live: rerun {plan.viewer_url}")
    _start(plan, supervisor)
    with _client(plan, mind) as client:
        arrived: queue.SimpleQueue[EpisodeSummary] = queue.SimpleQueue()
        client.subscribe(EPISODE, EpisodeSummary, arrived.put)
        phase = "starting"
        next_poll = 0.0
        while phase != "finished":
            mind()
            _drain(arrived, progress, plan.run)
            if time.monotonic() >= next_poll:
                next_poll = time.monotonic() + POLL_S
                experiment = _experiment(client)
                if experiment is not None:
                    phase = experiment.phase
                    progress.done = max(progress.done, experiment.episodes_done)
                    progress.episodes = max(plan.episodes, experiment.episodes_done)
            reporter.show(supervisor.alive(), phase)
        _drain(arrived, progress, plan.run)
        reporter.show(supervisor.alive(), phase, now=True)
        seed = plan.arguments.seed
        finish(client, plan.definition, seed, plan.run, progress.done, plan.out, mind, reporter.say)


def _client(plan: Plan, mind: Callable[[], None]) -> Client:
    """Return a client of the router that was just started, minding the processes meanwhile."""
    deadline = time.monotonic() + 30.0
    while True:
        mind()
        try:
            return Client(Options(plan.arguments.cell, (plan.endpoint,), connect_timeout_s=0.5))
        except CellError:
            if time.monotonic() > deadline:
                raise


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


class _StopFlag:
    """True once SIGINT or SIGTERM has come."""

    def __init__(self) -> None:
        self._set = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)

    def __bool__(self) -> bool:
        return self._set

    def _on_signal(self, _number: int, _frame: object) -> None:
        self._set = True
