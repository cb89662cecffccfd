"""``treenail swap``: another classifier, or another learner or policy of the agent, while a cell learns."""

from __future__ import annotations

import argparse
import json
import time
import uuid

import msgspec

from services.cell import client
from services.cell.client import Client
from services.rules.command_line import number, whole
from services.rules.swaps import Wish, in_force, request_for, words
from services.wire.errors import NoAnswerError, RefusedError, SwapError
from services.wire.keys import EXPERIMENT, SWAP
from services.wire.messages import Experiment, Swapped, SwapRequest

ANSWER_WITHIN_S = 3.0
RETRY_S = 0.5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parsers = parser.add_subparsers(dest="service", metavar="agent|classifier", required=True)
    agent = parsers.add_parser("agent", help="another learner or policy; Q-learning and SARSA hand over their Q-table")
    agent.add_argument("--learner", metavar="KIND", help="q_learning, sarsa, or one that a package registers")
    agent.add_argument("--policy", metavar="KIND", help="greedy, epsilon_greedy, epsilon_annealed or softmax")
    classifier = parsers.add_parser("classifier", help="another classifier or vigilance; all starts fresh with it")
    classifier.add_argument("--classifier", metavar="KIND", help="art2, or one that a package registers")
    classifier.add_argument("--rho", metavar="RHO", help="vigilance, short for --set rho=RHO")
    for add in (agent, classifier):
        add.add_argument(
            "--set", action="append", default=[], metavar="KEY=VALUE", help="a setting, as alpha=0.05; may be repeated"
        )
        add.add_argument(
            "--at", type=whole(0), metavar="EPISODE", help="from that episode on (default: the next to begin)"
        )
        add.add_argument(
            "--timeout",
            type=number(0.0, 1e6, "seconds"),
            default=10.0,
            metavar="S",
            help="how long task and store get (default: 10)",
        )
        add.add_argument("--json", action="store_true", help="as JSON")
        client.add_arguments(add)


def act(arguments: argparse.Namespace) -> None:
    """Ask for the swap until task and store have confirmed it, and say what it means."""
    wish = wish_of(arguments)
    with client.client_of(arguments) as cell:
        swapped = swap(cell, wish, arguments.at, arguments.timeout)
    if arguments.json:
        print(json.dumps({"run": swapped.run, "number": swapped.number, "swap": msgspec.to_builtins(swapped.swap)}))
        return
    print(f"run {swapped.run}: swap {swapped.number}, {words(swapped.swap)}")


def wish_of(arguments: argparse.Namespace) -> Wish:
    """Return what parsed arguments ask for. Raises SwapError when it is nothing."""
    named = ("learner", "policy") if arguments.service == "agent" else ("classifier", "rho")
    given = [f"{name}={value}" for name in named if (value := getattr(arguments, name)) is not None]
    settings = (*given, *arguments.set)
    if not settings:
        raise SwapError(f"swap: expected --{named[0]}, --{named[1]} or --set, got none of them")
    return Wish(arguments.service, settings)


def swap(cell: Client, wish: Wish, episode: int | None, within_s: float) -> Swapped:
    """Return the swap that was made for a wish; worked out anew when somebody else's has come before it.

    Raises what ``ask`` and ``asked_for`` raise.
    """
    deadline = time.monotonic() + within_s
    running = cell.ask(EXPERIMENT, Experiment)
    while True:
        now, after = in_force(running.definition, running.swaps), len(running.swaps)
        request = request_for(running.run, now, wish, episode, uuid.uuid4().hex, after)
        try:
            return ask(cell, request, max(0.0, deadline - time.monotonic()))
        except RefusedError as error:
            if error.reason != "out_of_order" or time.monotonic() > deadline:
                raise
            running = cell.ask(EXPERIMENT, Experiment)
            if len(running.swaps) == after:
                raise


def ask(cell: Client, request: SwapRequest, within_s: float) -> Swapped:
    """Return the reply to a request, asking again with the same while nobody gives one and the store is not ready.

    Raises RefusedError or NoAnswerError: after the latter the swap may have been made or not; ``treenail status`` says.
    """
    deadline = time.monotonic() + within_s
    while True:
        try:
            return cell.request(SWAP, request, Swapped, ANSWER_WITHIN_S)
        except (NoAnswerError, RefusedError) as error:
            refused = isinstance(error, RefusedError) and error.reason != "not_ready"
            if refused or time.monotonic() > deadline:
                raise
        time.sleep(RETRY_S)
