"""The ``treenail`` command: starts cells, asks them, runs experiments. Only what a command needs is loaded for it."""

from __future__ import annotations

import os
import signal
import sys


def _end_early(_number: int, _frame: object) -> None:
    """Ctrl-C while modules are loaded: there is nothing to clean up, and in other people's code it could get lost."""
    os.write(2, b"treenail: interrupted\n")
    os._exit(130)


_is_command = __name__ == "__main__" or os.path.basename(sys.argv[0]) == "treenail"
if _is_command and signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not ignored, as in the background
    signal.signal(signal.SIGINT, _end_early)

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

# By python -m, unlike the installed command: a file of the user's is no module of ours, whatever its name.
if not sys.flags.safe_path and Path(sys.path[0]).resolve() not in Path(__file__).resolve().parents:
    del sys.path[0]

from services.rules import command_line
from services.rules.command_line import Parser, RawHelp, did_you_mean, module_command, service_module

SERVICES = {
    "router": "Zenoh's router",
    "sim": "the simulator, in place of robot and sensor",
    "sensor_jr3": "a JR3 force/torque sensor",
    "robot_link": "an arm behind a VAL II controller",
    "robot_ur": "an arm of Universal Robots",
    "sensor_rdt": "an ATI Net F/T, an Axia or an OnRobot HEX",
    "ros2_robot": "an arm behind a Cartesian controller of ROS 2",
    "ros2_sensor": "a force/torque topic of ROS 2",
    "task": "one insertion task",
    "classifier": "F/T vectors to contact states (ART2)",
    "agent": "contact states to moves (Q-learning, SARSA)",
    "store": "checkpoints and journal; store check FILE, store salvage FILE OUT: a damaged file",
    "viewer": "live view in Rerun",
    "ros2_out": "what a cell feels and does, as topics of ROS 2",
}

COMMANDS = {
    "up": "bring up a whole cell on this machine and run an experiment",
    "status": "print who is alive, and how it goes",
    "top": "watch rates and latencies of a cell",
    "get": "print what a key of the cell answers, as JSON",
    "q-table": "print the agent's Q-table",
    "policy": "print what the agent would do in a state, or when it feels a force",
    "resume": "let the arm move again after a stop",
    "tare": "measure a tool's weight and its sensor's noise in six poses",
    "swap": "change learner or classifier while a cell learns",
    "checkpoint": "list, show, export and import what was learnt",
    "evaluate": "say how good a skill is on a task, beside a hand-written rule",
    "export": "write a run as MCAP, Parquet or a LeRobot dataset",
    "record": "write the F/T stream of a living cell to MCAP, bounded",
    "video": "show one insertion of a run as a film",
    "runs": "list the runs in a folder with their sizes, and remove them",
    "certs": "make a certificate authority and a certificate for each service",
}
"""Each is a module of ``treenail.commands``; its ``act`` returns the exit status, 0 or 1."""

STUDIES = {
    "experiment": "run an experiment in one process, without Zenoh",
    "leaderboard": "hold learners and a hand-written rule against each other on a suite of tasks",
    "deep": "hold deep learners of stable-baselines3 against Treenail's own on the same starts",
    "compare": "overlay the curves of any runs, and print their figures beside each other",
    "bench": "measure speed on this machine",
    "replay": "rebuild a run's memory and log from its journal, and compare",
    "diff": "say where two runs part",
    "chaos": "kill and disturb a cell while it learns, and compare it with one left in peace",
    "reproduce": "compute the thesis's tables and figures anew, as one page",
    "oracle": "search the best insertion with full knowledge of the pose",
}

TOOLS = {
    "pterm": "a terminal for an old controller on a serial line",
    "pfloppy": "a floppy drive for an old controller (stand-in protocol)",
}


class Command(Protocol):
    """A module of ``treenail.commands``."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the command's options."""

    def act(self, arguments: argparse.Namespace) -> int | None:
        """Do it; return the exit status, None for 0."""


def main() -> None:
    """Run the command line; exit with its status."""
    name, words = (sys.argv[1], sys.argv[2:]) if len(sys.argv) > 1 else ("", [])
    a_file = name == "store" and words[:1] in (["check"], ["salvage"])
    if name in SERVICES and not a_file:
        os.execv(sys.executable, module_command(service_module(name), *words))
    program = f"treenail {name}" if a_file or name in (*COMMANDS, *STUDIES, *TOOLS) else "treenail"
    sys.exit(command_line.run(program, lambda: _act(name, words)))


def _act(name: str, words: list[str]) -> int | None:
    """Do what a command does; return its exit status."""
    if name in STUDIES or name in TOOLS:
        study = _study(name)
        _all_is_loaded()
        return study(words)
    if name == "store":
        from treenail.commands import store

        _all_is_loaded()
        return store.main(words)
    if name in COMMANDS:
        module = _module(name)
        _all_is_loaded()
        parser = Parser(prog=f"treenail {name}", description=COMMANDS[name])
        module.add_arguments(parser)
        return module.act(parser.parse_args(words))
    overview = _overview()
    if name and not name.startswith("-"):
        overview.error(f"unknown command {name!r}{did_you_mean(name, (*COMMANDS, *STUDIES, *TOOLS, *SERVICES))}")
    if name:
        overview.parse_args([name])
    overview.print_help()
    return 0


def _all_is_loaded() -> None:
    """From now on Ctrl-C is for the command to deal with."""
    if signal.getsignal(signal.SIGINT) is _end_early:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _module(name: str) -> Command:
    """Return the module of a command. Each is slow to load beside what it needs itself, so only one is."""
    match name:
        case "up":
            from treenail.commands import up

            return up
        case "status":
            from treenail.commands import status

            return status
        case "top":
            from treenail.commands import top

            return top
        case "get":
            from treenail.commands import get

            return get
        case "q-table":
            from treenail.commands import q_table

            return q_table
        case "policy":
            from treenail.commands import policy

            return policy
        case "resume":
            from treenail.commands import resume

            return resume
        case "tare":
            from treenail.commands import tare

            return tare
        case "swap":
            from treenail.commands import swap

            return swap
        case "checkpoint":
            from treenail.commands import checkpoint

            return checkpoint
        case "evaluate":
            from treenail.commands import evaluate

            return evaluate
        case "export":
            from treenail.commands import export

            return export
        case "record":
            from treenail.commands import record

            return record
        case "video":
            from treenail.commands import video

            return video
        case "runs":
            from treenail.commands import runs

            return runs
        case _:
            from treenail.commands import certs

            return certs


def _study(name: str) -> Callable[[list[str]], int]:
    """Return the main function of a study or a tool, which reads its own words."""
    match name:
        case "experiment":
            from treenail.commands.experiment import main
        case "leaderboard":
            from treenail.commands.leaderboard import main
        case "deep":
            from treenail.commands.deep import main
        case "compare":
            from treenail.commands.compare import main
        case "bench":
            from experiments.bench.__main__ import main
        case "replay":
            from experiments.journal.replay_command import main
        case "diff":
            from experiments.journal.diff_command import main
        case "chaos":
            from experiments.chaos.__main__ import main
        case "reproduce":
            from experiments.reproduce.__main__ import main
        case "oracle":
            from experiments.oracle.__main__ import main
        case "pterm":
            from treenail.tools.pterm.__main__ import main
        case _:
            from treenail.tools.pfloppy.__main__ import main
    return main


def _overview() -> Parser:
    """Return a parser that reads no command: for help, the version, and the error about an unknown one."""
    groups = {
        "commands": COMMANDS,
        "studies, without a cell": STUDIES,
        "tools for old controllers": TOOLS,
        "one service as one process": SERVICES,
    }
    parser = Parser(
        prog="treenail",
        usage="treenail COMMAND ...",
        description="A robot learns to put pegs into holes by feel.",
        epilog="\n\n".join(f"{title}:\n{_table(names)}" for title, names in groups.items()) + "\n\neach has --help",
        formatter_class=RawHelp,
    )
    from services.wire.version import version

    parser.add_argument("--version", action="version", version=f"treenail {version()}")
    return parser


def _table(names: dict[str, str]) -> str:
    return "\n".join(f"  {name:<12}{summary}" for name, summary in names.items())


if __name__ == "__main__":
    main()
