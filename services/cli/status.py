"""``treenail status``: print who is alive in a cell, and how it goes."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence

from rich.table import Table

from services.cli import client
from services.cli.terminal import console
from services.wire.errors import NoAnswerError
from services.wire.messages import Alive


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("--json", action="store_true", help="as JSON")
    client.add_arguments(parser)


def act(arguments: argparse.Namespace) -> None:
    """Print a row a service; rates are measured over one second."""
    with client.client_of(arguments) as cell:
        before = {alive.service: alive for alive in cell.ask_all("alive/*", Alive)}
        time.sleep(1.0)
        after = {alive.service: alive for alive in cell.ask_all("alive/*", Alive)}
        present = cell.alive()
    names = sorted({*after, *present})
    if not names:
        raise NoAnswerError(f"cell {cell.keys.cell!r}: nobody is alive")
    if arguments.json:
        print(json.dumps([_row(name, before, after, present) for name in names]))
        return
    table = Table(title=f"Cell {cell.keys.cell}")
    headings = ("service", "phase", "messages/s", "handled", "refused", "run", "version", "contract", "host", "pid")
    for heading in headings:
        table.add_column(heading, overflow="fold")
    for name in names:
        row = _row(name, before, after, present)
        table.add_row(*("" if row[heading] is None else str(row[heading]) for heading in headings))
    console().print(table)


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
