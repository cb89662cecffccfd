"""The ``treenail`` command: starts cells, asks them, runs experiments. It knows services by name only."""

from __future__ import annotations

import argparse
import os
import sys
from typing import Protocol

from services.bus.command import EXIT_ERROR, Parser
from services.wire.errors import TreenailError
from services.wire.version import version

SERVICES = {
    "router": "Zenoh's router",
    "sim": "the simulator, in place of robot and sensor",
    "sensor_jr3": "a JR3 force/torque sensor",
    "robot_link": "an arm behind a VAL II controller",
    "task": "one insertion task",
    "classifier": "F/T vectors to contact states (ART2)",
    "agent": "contact states to moves (Q-learning, SARSA)",
    "store": "checkpoints and journal",
    "viewer": "live view in Rerun",
}

COMMANDS = {
    "up": "bring up a whole cell on this machine and run an experiment",
    "status": "print who is alive, and how it goes",
    "top": "watch rates and latencies of a cell",
    "get": "print what a key of the cell answers, as JSON",
    "q-table": "print the agent's Q-table",
    "policy": "print what the agent would do in a state, or when it feels a force",
    "swap": "change learner or classifier while a cell learns",
    "checkpoint": "list, show, export and import what was learnt",
    "certs": "make a certificate authority and a certificate for each service",
}
"""Each is a module of ``treenail.commands``; its ``act`` returns the exit status, 0 or 1."""

STUDIES = {
    "experiment": ("treenail.commands.experiment", "run an experiment in one process, without Zenoh"),
    "bench": ("experiments.bench", "measure speed on this machine"),
    "replay": ("experiments.journal.replay_command", "rebuild a run's memory and log from its journal, and compare"),
    "diff": ("experiments.journal.diff_command", "say where two runs part"),
    "chaos": ("experiments.chaos", "kill and disturb a cell while it learns, and compare it with one left in peace"),
    "reproduce": ("experiments.reproduce", "compute the thesis's tables and figures anew, as one page"),
    "oracle": ("experiments.oracle", "search the best insertion with full knowledge of the pose"),
}

TOOLS = {
    "pterm": ("treenail.tools.pterm", "a terminal for an old controller on a serial line"),
    "pfloppy": ("treenail.tools.pfloppy", "a floppy drive for an old controller (stand-in protocol)"),
}


class Command(Protocol):
    """A module of ``treenail.commands``."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the command's options."""

    def act(self, arguments: argparse.Namespace) -> int | None:
        """Do it; return the exit status, None for 0."""


def main() -> None:
    """Run the command line; exit with its status."""
    name, rest = (sys.argv[1], sys.argv[2:]) if len(sys.argv) > 1 else ("", [])
    if name in SERVICES:
        _become(f"services.{name}", rest)
    if name in STUDIES:
        _become(STUDIES[name][0], rest)
    if name in TOOLS:
        _become(TOOLS[name][0], rest)
    if name not in COMMANDS:
        _overview().parse_args([name] if name else [])
    try:
        sys.exit(_command(name, rest))
    except TreenailError as error:
        print(f"treenail {name}: {error}", file=sys.stderr)
        sys.exit(EXIT_ERROR)
    except KeyboardInterrupt:
        sys.exit(130)


def _command(name: str, words: list[str]) -> int:
    """Run one of COMMANDS and return its exit status; only its own module is loaded."""
    module = _module(name)
    parser = Parser(prog=f"treenail {name}", description=COMMANDS[name])
    module.add_arguments(parser)
    return module.act(parser.parse_args(words)) or 0


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
        case "swap":
            from treenail.commands import swap

            return swap
        case "checkpoint":
            from treenail.commands import checkpoint

            return checkpoint
        case _:
            from treenail.commands import certs

            return certs


def _become(module: str, arguments: list[str]) -> None:
    """Replace this process by one of a module; ``-P``: nothing in the current folder is taken for one of ours."""
    os.execv(sys.executable, [sys.executable, "-P", "-m", module, *arguments])


def _overview() -> argparse.ArgumentParser:
    """Return a parser that knows no command: for help, the version, and the error about an unknown one."""
    groups = {
        "commands": COMMANDS,
        "studies, without a cell": {name: summary for name, (_, summary) in STUDIES.items()},
        "tools for old controllers": {name: summary for name, (_, summary) in TOOLS.items()},
        "one service as one process": SERVICES,
    }
    parser = Parser(
        prog="treenail",
        usage="treenail COMMAND ...",
        description="A robot learns to put pegs into holes by feel.",
        epilog="\n\n".join(f"{title}:\n{_table(names)}" for title, names in groups.items()) + "\n\neach has --help",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"treenail {version()}")
    known = (*COMMANDS, *STUDIES, *TOOLS, *SERVICES)
    parser.add_argument("command", choices=known, metavar="COMMAND", help=argparse.SUPPRESS)
    return parser


def _table(names: dict[str, str]) -> str:
    return "\n".join(f"  {name:<12}{summary}" for name, summary in names.items())


if __name__ == "__main__":
    main()
