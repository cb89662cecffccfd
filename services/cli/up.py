"""``treenail up``: a whole cell on this machine, supervised, to the end of its run."""

from __future__ import annotations

import argparse
import queue
import signal
import socket
import time
from dataclasses import dataclass
from pathlib import Path

from services.cli.client import Client
from services.cli.finish import finish
from services.cli.progress import Progress, Reporter
from services.cli.supervisor import Supervisor
from services.wire.definition import Definition
from services.wire.definition_file import definition_sha256, find, load, run_id
from services.wire.errors import CellError, ContractError, NoAnswerError, RefusedError, TreenailError
from services.wire.keys import EPISODE, EXPERIMENT
from services.wire.messages import EpisodeSummary, Experiment

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


def up(arguments: argparse.Namespace) -> int:
    """Bring a cell up, watch it to the end of its run, write the results; return the exit status."""
    plan = _plan(arguments)
    stop = _StopFlag()
    plan.out.mkdir(parents=True, exist_ok=True)
    (plan.out / "logs").mkdir(exist_ok=True)
    if arguments.fresh:
        for stale in plan.out.glob("store.sqlite*"):
            stale.unlink()
    progress = Progress(plan.episodes)
    title = f"{plan.definition.name}, seed {arguments.seed}"
    with Reporter(progress, title, plan.viewer_url) as reporter:
        supervisor = Supervisor(plan.out / "logs", reporter.say)
        try:
            return _run(plan, supervisor, reporter, progress, stop)
        finally:
            _stop(supervisor, reporter)


def _plan(arguments: argparse.Namespace) -> Plan:
    definition = load(arguments.experiment, arguments.set)
    episodes = definition.episodes if arguments.episodes is None else arguments.episodes
    if episodes < 1:
        raise TreenailError(f"--episodes: expected 1 or more, got {episodes}")
    if not 0 <= arguments.seed < 2**63:
        raise TreenailError(f"--seed: expected 0 to 2^63-1, got {arguments.seed}")
    run = run_id(definition, arguments.seed)
    out = arguments.out or Path("runs") / f"{definition.name}-{definition_sha256(definition)[:8]}-s{arguments.seed}"
    port = _free_port("127.0.0.1", arguments.port, "--port")
    viewer_url = ""
    if not arguments.no_viewer:
        arguments.viewer_port = _free_port(arguments.viewer_bind, arguments.viewer_port, "--viewer-port")
        host = socket.gethostname() if arguments.viewer_bind == "0.0.0.0" else arguments.viewer_bind
        viewer_url = f"rerun+http://{host}:{arguments.viewer_port}/proxy"
    return Plan(arguments, definition, run, episodes, out, f"tcp/127.0.0.1:{port}", viewer_url)


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


def _run(plan: Plan, supervisor: Supervisor, reporter: Reporter, progress: Progress, stop: _StopFlag) -> int:
    reporter.say(f"run {plan.run} in {plan.out}; logs in {plan.out / 'logs'}")
    if plan.viewer_url:
        reporter.say(f"watch it live: rerun {plan.viewer_url}")
    _start(plan, supervisor)
    with _client(plan, supervisor, stop) as client:
        arrived: queue.SimpleQueue[EpisodeSummary] = queue.SimpleQueue()
        client.subscribe(EPISODE, EpisodeSummary, arrived.put)
        phase = "starting"
        next_poll = 0.0
        while not stop:
            supervisor.check()
            _drain(arrived, progress, plan.run)
            if time.monotonic() >= next_poll:
                next_poll = time.monotonic() + POLL_S
                experiment = _experiment(client)
                if experiment is not None:
                    phase = experiment.phase
                    progress.done = max(progress.done, experiment.episodes_done)
                    progress.episodes = max(plan.episodes, experiment.episodes_done)
            reporter.show(supervisor.alive(), phase)
            if phase == "finished":
                break
        _drain(arrived, progress, plan.run)
        if stop:
            reporter.say(f"stopped at episode {progress.done}; the same command goes on from there")
            return EXIT_INTERRUPTED
        reporter.show(supervisor.alive(), phase, now=True)
        finish(client, plan.definition, plan.arguments.seed, plan.run, plan.out, supervisor.check, reporter.say)
    return 0


def _client(plan: Plan, supervisor: Supervisor, stop: _StopFlag) -> Client:
    """Return a client of the router that was just started, minding the processes meanwhile."""
    deadline = time.monotonic() + 30.0
    while True:
        try:
            return Client(plan.arguments.cell, [plan.endpoint], timeout_s=0.5)
        except CellError:
            supervisor.check()
            if stop or time.monotonic() > deadline:
                raise


def _experiment(client: Client) -> Experiment | None:
    try:
        return client.ask(EXPERIMENT, Experiment, timeout_s=1.0)
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
