"""The command line and logging that all services share."""

from __future__ import annotations

import argparse
import ctypes
import logging
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

from services.bus.room import Room
from services.bus.service import Options
from services.bus.session import DEFAULT_ENDPOINT, DEFAULT_SECURE_ENDPOINT
from services.bus.turns import ask_for_short_turns
from services.rules import command_line
from services.rules.command_line import EXIT_ERROR, Parser, number, whole
from services.wire.errors import RoleTakenError
from services.wire.keys import READERS

DIE_WITH_PARENT = "TREENAIL_DIE_WITH_PARENT"
"""Environment variable with the process id of the parent to die with."""
CELL = "TREENAIL_CELL"
CONNECT = "TREENAIL_CONNECT"
CERTS = "TREENAIL_CERTS"
FLEET = "TREENAIL_FLEET"
"""Environment variables that stand in for options, so that a container or a shell is told once."""
_PR_SET_PDEATHSIG = 1
MAX_FLEET = 1000
CLIENT_WAITS_S = 5.0
EXIT_OUSTED = 3
"""Exit status of a service that gave way to an earlier holder of its role: started again, it waits for the role."""


def parser(name: str, summary: str) -> Parser:
    """Return a parser with the options that every service takes."""
    command = Parser(prog=f"treenail {name}", description=summary)
    add_arguments(command)
    command.add_argument(
        "--fleet",
        type=whole(1, MAX_FLEET),
        default=os.environ.get(FLEET) or None,
        metavar="N",
        help=f"stand in the first of the cells 1 to N that is without this service (default: ${FLEET}, else --cell)",
    )
    return command


def add_arguments(command: argparse.ArgumentParser, connect_timeout_s: float | None = 30.0) -> None:
    """Add the options that say which cell, where its router is, and who we are; a time of None is a client's."""
    hurry = f" (default: {CLIENT_WAITS_S:g}, but not where nobody listens)" if connect_timeout_s is None else ""
    command.add_argument("--cell", default=os.environ.get(CELL, "a"), help=f"name of the cell (default: ${CELL} or a)")
    command.add_argument(
        "--connect",
        action="append",
        metavar="ENDPOINT",
        help=f"Zenoh endpoint of the router, may be repeated (default: ${CONNECT}, with commas, or {DEFAULT_ENDPOINT})",
    )
    command.add_argument(
        "--connect-timeout",
        type=number(0.01, 1e6, "seconds"),
        default=connect_timeout_s,
        metavar="S",
        help=f"seconds to wait for the router{hurry}",
    )
    add_certs(command)


def add_certs(command: argparse.ArgumentParser) -> None:
    """Add the option that says who we are."""
    command.add_argument(
        "--certs",
        type=Path,
        default=os.environ.get(CERTS) or None,
        metavar="FOLDER",
        help=f"folder with ca.pem, cert.pem and key.pem, from treenail certs, for mutual TLS (default: ${CERTS})",
    )


def options(arguments: argparse.Namespace, room: Room | None = None) -> Options:
    """Return the shared options of parsed arguments, for a service in a process of its own or in a ``room``."""
    told = [word.strip() for word in os.environ.get(CONNECT, "").split(",") if word.strip()]
    usual = DEFAULT_ENDPOINT if arguments.certs is None else DEFAULT_SECURE_ENDPOINT
    connect = tuple(arguments.connect or told or (usual,))
    fleet = getattr(arguments, "fleet", None)  # not an option of clients
    timeout_s = CLIENT_WAITS_S if arguments.connect_timeout is None else arguments.connect_timeout
    return Options(arguments.cell, connect, timeout_s, arguments.certs, fleet, room)


def die_with_parent() -> None:
    """Ask Linux to kill this process when the one that started it dies, however it dies (set by ``treenail up``)."""
    parent = os.environ.get(DIE_WITH_PARENT)
    if parent is None:
        return
    # Not SIGTERM: a suspended process would keep it until somebody wakes it, and everything it holds until then.
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if str(os.getppid()) != parent:
        sys.exit(EXIT_ERROR)  # it died before we asked


def run(name: str, main: Callable[[], None]) -> NoReturn:
    """Run a service's main function and end the process: with 2 after an error of ours, which is one line.

    Who works in the cell asks for short turns on the processor, who only watches does not.
    """
    die_with_parent()
    if name not in READERS:
        ask_for_short_turns()
    logging.basicConfig(stream=sys.stdout, level=logging.INFO, format="%(asctime)s %(name)s %(levelname)s %(message)s")

    def act() -> None:
        try:
            main()
        except RoleTakenError as error:
            print(f"treenail {name}: {error}", file=sys.stderr)
            raise SystemExit(EXIT_OUSTED) from None

    sys.exit(command_line.run(f"treenail {name}", act, interrupted=None))
