"""``treenail q-table``: print the agent's Q-table."""

from __future__ import annotations

import argparse
import json

from rich.table import Table

from services.cell import client
from services.cell.terminal import console
from services.wire.keys import Q_TABLE
from services.wire.messages import QTable


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("--json", action="store_true", help="as JSON")
    client.add_arguments(parser)


def act(arguments: argparse.Namespace) -> None:
    """Print a row a state: its best action first, then the value of each action."""
    with client.client_of(arguments) as cell:
        if arguments.json:
            print(json.dumps(cell.ask_one_json(Q_TABLE)))
            return
        answer = cell.ask(Q_TABLE, QTable)
    if not answer.actions:
        print(f"run {answer.run}: moves are proposed, there are no values of actions: treenail policy --ft ...")
        return
    console().print(table(answer))


def table(answer: QTable) -> Table:
    """Return a Q-table for people; the value of the best action is bold."""
    title = f"Q-table of run {answer.run} after {answer.decisions} decisions (version {answer.policy_version})"
    if answer.partial:
        title += "\nwhat comes after a move; what it earns at once is the felt model's part: treenail policy --ft ..."
    rows = Table(title=title)
    for heading in ("state", "best", "visits", *answer.actions):
        rows.add_column(heading, justify="right", no_wrap=True)
    for state, (values, visits, best) in enumerate(zip(answer.q, answer.visits, answer.best_action, strict=True)):
        cells = [f"[bold]{value:.2f}[/bold]" if index == best else f"{value:.2f}" for index, value in enumerate(values)]
        rows.add_row(str(state), answer.actions[best], str(sum(visits)), *cells)
    return rows
