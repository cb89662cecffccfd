"""``treenail get``, ``q-table`` and ``status``: what a cell answers, for people and for scripts."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from services.cli.client import Client
from services.wire.errors import NoAnswerError
from services.wire.keys import Q_TABLE
from services.wire.messages import Alive, QTable


def get(client: Client, arguments: argparse.Namespace) -> None:
    """Print the answers to a query as JSON: one value, or an object by key when the key has wildcards."""
    answers = client.ask_json(arguments.key)
    if not answers:
        raise NoAnswerError(f"{client.keys.of(arguments.key)}: nobody answered")
    wild = "*" in arguments.key.partition("?")[0]
    print(json.dumps(answers if wild else next(iter(answers.values())), indent=None if arguments.compact else 2))


def q_table(client: Client, arguments: argparse.Namespace) -> None:
    """Print the Q-table: a row a state, its best action first, then the value of each action."""
    answer = client.ask(Q_TABLE, QTable)
    if arguments.json:
        print(json.dumps(client.ask_json(Q_TABLE)[client.keys.of(Q_TABLE)]))
        return
    table = Table(
        title=f"Q-table of run {answer.run} after {answer.decisions} decisions (version {answer.policy_version})"
    )
    for heading in ("state", "best", "visits", *answer.actions):
        table.add_column(heading, justify="right", no_wrap=True)
    for state, (values, visits, best) in enumerate(zip(answer.q, answer.visits, answer.best_action, strict=True)):
        cells = [f"[bold]{value:.2f}[/bold]" if index == best else f"{value:.2f}" for index, value in enumerate(values)]
        table.add_row(str(state), answer.actions[best], str(sum(visits)), *cells)
    _console().print(table)


def status(client: Client, arguments: argparse.Namespace) -> None:
    """Print who is alive in the cell and how it goes; rates are measured over one second."""
    before = {alive.service: alive for alive in client.ask_all("alive/*", Alive)}
    time.sleep(1.0)
    after = {alive.service: alive for alive in client.ask_all("alive/*", Alive)}
    present = client.alive()
    names = sorted({*after, *present})
    if not names:
        raise NoAnswerError(f"cell {client.keys.cell!r}: nobody is alive")
    if arguments.json:
        print(json.dumps([_row(name, before, after, present) for name in names]))
        return
    table = Table(title=f"Cell {client.keys.cell}")
    headings = ("service", "phase", "messages/s", "handled", "refused", "run", "version", "contract", "host", "pid")
    for heading in headings:
        table.add_column(heading, overflow="fold")
    for name in names:
        row = _row(name, before, after, present)
        table.add_row(*("" if row[heading] is None else str(row[heading]) for heading in headings))
    _console().print(table)


def _row(
    name: str, before: dict[str, Alive], after: dict[str, Alive], present: Sequence[str]
) -> dict[str, str | int | float | None]:
    here = after.get(name)
    if here is None:
        empty = dict.fromkeys(("messages/s", "handled", "refused", "run", "version", "contract", "host", "pid"))
        return {"service": name, "phase": "hung: here, but not answering", **empty}
    earlier = before.get(name)
    same = earlier is not None and earlier.instance == here.instance
    return {
        "service": name,
        "phase": here.phase if name in present else f"not ready: {here.phase}",
        "messages/s": here.handled - earlier.handled if same and earlier is not None else None,
        "handled": here.handled,
        "refused": ", ".join(f"{count} {error}" for error, count in sorted(here.refused.items())) or 0,
        "run": here.run,
        "version": here.version,
        "contract": here.contract_sha256[:12],
        "host": here.host,
        "pid": here.pid,
    }


def _console() -> Console:
    """Return a console that does not break tables when it is not a terminal."""
    console = Console()
    return console if console.is_terminal else Console(width=160)
