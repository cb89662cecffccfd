"""``treenail get``: print what a key of the cell answers, as JSON."""

from __future__ import annotations

import argparse
import json

from services.cli import client
from services.wire.errors import NoAnswerError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("key", help="key within the cell, such as agent/q_table or agent/policy?state=7")
    parser.add_argument("--compact", action="store_true", help="on one line")
    client.add_arguments(parser)


def act(arguments: argparse.Namespace) -> None:
    """Print one value, or an object by key when the key has wildcards."""
    with client.client_of(arguments) as cell:
        answers = cell.ask_json(arguments.key)
        if not answers:
            raise NoAnswerError(f"{cell.keys.of(arguments.key)}: nobody answered")
    wild = "*" in arguments.key.partition("?")[0]
    print(json.dumps(answers if wild else next(iter(answers.values())), indent=None if arguments.compact else 2))
