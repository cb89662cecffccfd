"""``treenail get``: print what a key of the cell answers, as JSON."""

from __future__ import annotations

import argparse
import json
import sys

from services.cell import client
from services.wire.errors import RefusedError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("key", help="key within the cell, such as agent/q_table, 'agent/policy?state=7' or 'alive/*'")
    parser.add_argument("--compact", action="store_true", help="on one line")
    client.add_arguments(parser)


def act(arguments: argparse.Namespace) -> None:
    """Print one value, or an object by key when the key has wildcards; then some of those asked may refuse."""
    wild = "*" in arguments.key.partition("?")[0]
    with client.client_of(arguments) as cell:
        answers, refusals = cell.ask_json(arguments.key)
        if not answers and not refusals:
            raise cell.no_answer(arguments.key)
        if refusals and not (wild and answers):
            raise RefusedError(f"{cell.keys.of(arguments.key)}: {refusals[0]}")
    for refusal in refusals:
        print(f"treenail get: {arguments.key}: {refusal}", file=sys.stderr)
    print(json.dumps(answers if wild else next(iter(answers.values())), indent=None if arguments.compact else 2))
