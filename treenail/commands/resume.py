"""``treenail resume``: let the arm move again after an emergency stop, a refusal of its controller, or its start."""

from __future__ import annotations

import argparse

from services.cell import client
from services.cell.client import Client
from services.wire.keys import RESUME
from services.wire.messages import Resume, Stop

ANSWER_WITHIN_S = 3.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("--look", action="store_true", help="only say what holds the arm")
    client.add_arguments(parser)


def act(arguments: argparse.Namespace) -> None:
    """Say what holds the arm and, unless ``--look``, let it move."""
    with client.client_of(arguments) as cell:
        stop = cell.ask(RESUME, Stop)
        if stop.stop_t_ns == 0:
            print("nothing holds the arm")
            return
        if arguments.look:
            print(f"stopped: {stop.why}")
            return
        resume(cell, stop)
    print(f"the arm may move again; it was stopped: {stop.why}")


def resume(cell: Client, stop: Stop) -> None:
    """End a stop. Raises RefusedError when the arm cannot move yet or another stop has come, NoAnswerError."""
    cell.request(RESUME, Resume(stop_t_ns=stop.stop_t_ns), Stop, ANSWER_WITHIN_S)
