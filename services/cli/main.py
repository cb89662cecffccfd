"""The ``treenail`` command: starts cells, asks them, runs experiments. It knows services by name only."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable

from services.wire.command import EXIT_ERROR, Parser
from services.wire.errors import TreenailError
from services.wire.session import DEFAULT_ENDPOINT
from services.wire.version import version

SERVICES = {
    "router": "Zenoh's router",
    "sim": "the simulator, in place of robot and sensor",
    "task": "one insertion task",
    "classifier": "F/T vectors to contact states (ART2)",
    "agent": "contact states to moves (Q-learning, SARSA)",
    "store": "checkpoints and journal",
    "viewer": "live view in Rerun",
}

STUDIES = {"experiment": "experiments", "bench": "experiments.bench", "oracle": "experiments.oracle"}


def main() -> None:
    """Run the command line; exit with its status."""
    arguments = sys.argv[1:]
    if arguments and arguments[0] in SERVICES:
        _become(f"services.{arguments[0]}", arguments[1:])
    if arguments and arguments[0] in STUDIES:
        _become(STUDIES[arguments[0]], arguments[1:])
    try:
        parsed = _parser().parse_args(arguments)
        sys.exit(parsed.act(parsed) or 0)
    except TreenailError as error:
        print(f"treenail {arguments[0]}: {error}", file=sys.stderr)
        sys.exit(EXIT_ERROR)
    except KeyboardInterrupt:
        sys.exit(130)


def _become(module: str, arguments: list[str]) -> None:
    """Replace this process by ``python -m module``."""
    os.execv(sys.executable, [sys.executable, "-m", module, *arguments])


def _parser() -> argparse.ArgumentParser:
    services = "\n".join(f"  {name:<12}{summary}" for name, summary in SERVICES.items())
    parser = Parser(
        prog="treenail",
        description="A robot learns to put pegs into holes by feel.",
        epilog=f"one service as one process:\n{services}\n\nalso: {', '.join(STUDIES)}; each has --help",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"treenail {version()}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _add_up(commands)
    _add_query(commands, "get", "print what a key of the cell answers, as JSON").add_argument(
        "key", help="key within the cell, such as agent/q_table or agent/policy?state=7"
    )
    commands.choices["get"].add_argument("--compact", action="store_true", help="on one line")
    for name, summary in (("q-table", "print the agent's Q-table"), ("status", "print who is alive, and how it goes")):
        _add_query(commands, name, summary).add_argument("--json", action="store_true", help="as JSON")
    return parser


def _add_up(commands: argparse._SubParsersAction[Parser]) -> None:
    def act(arguments: argparse.Namespace) -> int:
        from services.cli.up import up

        return up(arguments)

    from services.cli.up import add_arguments

    made = commands.add_parser("up", help="bring up a whole cell on this machine and run an experiment")
    add_arguments(made)
    made.set_defaults(act=act)


def _add_query(commands: argparse._SubParsersAction[Parser], name: str, summary: str) -> argparse.ArgumentParser:
    made = commands.add_parser(name, help=summary, description=summary)
    made.add_argument("--cell", default="a", help="name of the cell (default: a)")
    made.add_argument(
        "--connect", action="append", metavar="ENDPOINT", help=f"the router's endpoint (default: {DEFAULT_ENDPOINT})"
    )
    made.set_defaults(act=lambda arguments: _query(name, arguments))
    return made


def _query(name: str, arguments: argparse.Namespace) -> None:
    from services.cli import queries
    from services.cli.client import Client

    acts: dict[str, Callable[[Client, argparse.Namespace], None]] = {
        "get": queries.get,
        "q-table": queries.q_table,
        "status": queries.status,
    }
    with Client(arguments.cell, arguments.connect or [DEFAULT_ENDPOINT]) as client:
        acts[name](client, arguments)


if __name__ == "__main__":
    main()
