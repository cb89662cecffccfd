"""``treenail top``: watch rates and latencies of a cell.

Nothing here can slow the cell down: what arrives goes into a ring, of which the newest is kept, and is read outside of
Zenoh's threads.
"""

from __future__ import annotations

import argparse
import json
import signal
import time

from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from services.bus.inbox import HEARTBEAT_S
from services.bus.stop_flag import StopFlag
from services.cell import client
from services.cell.terminal import console
from services.cell.traffic import Heart, Traffic
from services.cell.watch import Watch
from services.rules.command_line import number

SHOW_EVERY_S = 1.0
WINDOW_S = 10
"""Rates of the live table are those of so many last seconds."""
ONCE_S = 3.0
HUNG_S = 3 * HEARTBEAT_S
ABOUT = """Latencies are times between messages, from the timestamps that Zenoh gives them where they are
published: classifier from observation to state, agent from state to action, robot from action to reward, decision
from observation to reward. Between two machines that needs synchronised clocks. In a terminal the table is live until
Ctrl-C; elsewhere, and with --once, --seconds or --json, it is printed once."""
NOTES = {
    "classifier": "observation to state",
    "agent": "state to action",
    "robot": "action to reward",
    "decision": "observation to reward",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.epilog = ABOUT
    parser.add_argument("--once", action="store_true", help=f"print one table after {ONCE_S:g} seconds")
    parser.add_argument(
        "--seconds", type=number(0.1, 86400.0, "seconds"), metavar="S", help="print one table after so many seconds"
    )
    parser.add_argument("--json", action="store_true", help="as JSON, once")
    client.add_arguments(parser)


def act(arguments: argparse.Namespace) -> None:
    """Show the table, live or once."""
    shown = console()
    with client.client_of(arguments) as cell:
        if not cell.alive():
            raise cell.nobody()
        once = arguments.once or arguments.json or arguments.seconds is not None or not shown.is_terminal
        watch = Watch(cell, marks=1 if once else WINDOW_S)
        if not once:
            _live(watch, Live(console=shown, auto_refresh=False))
            return
        watch.read_for(arguments.seconds or ONCE_S)
        present, now = cell.alive(), time.monotonic()
    if arguments.json:
        print(json.dumps(figures(watch.traffic, cell.keys.cell, present, now)))
        return
    shown.print(view(watch.traffic, cell.keys.cell, present, now))


def figures(traffic: Traffic, cell: str, present: list[str], now_s: float) -> dict[str, object]:
    """Return the figures for programs, units in the names."""
    returns = traffic.pace.returns
    return {
        "cell": cell,
        "run": traffic.pace.run,
        "swaps": traffic.pace.swaps,
        "complete": traffic.complete,
        "moves_per_s": round(traffic.moves_per_s(now_s), 1),
        "episodes_per_min": round(traffic.episodes_per_min(now_s), 1),
        "return_10": sum(returns) / len(returns) if returns else None,
        "keys": {
            name: {"messages_per_s": round(rate, 1), "kB_per_s": round(size, 2), "bad": traffic.counts[name].bad}
            for name, (rate, size) in traffic.rates(now_s).items()
        },
        "latency_us": {
            leg: None
            if latency is None
            else {"count": latency[0], "median": round(latency[1], 1), "p99": round(latency[2], 1)}
            for leg, latency in traffic.latency_us().items()
        },
        "services": {
            name: _service(traffic.hearts.get(name), name in present, now_s)
            for name in sorted({*traffic.hearts, *present})
        },
    }


def view(traffic: Traffic, cell: str, present: list[str], now_s: float) -> Group:
    """Return the figures for people."""
    shown = figures(traffic, cell, present, now_s)
    mean = shown["return_10"]
    run = shown["run"] or "nothing runs"
    gain = "" if not isinstance(mean, float) else f", return of the last {len(traffic.pace.returns)} {mean:.1f}"
    pace = f"{shown['moves_per_s']} moves/s, {shown['episodes_per_min']} episodes/min{gain}"
    swapped = f", swaps in force: {shown['swaps']}" if shown["swaps"] else ""
    lost = [] if traffic.complete else [Text("more passed than could be read: rates are too low", style="red")]
    tables = (_keys(traffic, now_s), _latencies(traffic), _services(traffic, present, now_s))
    return Group(Text(f"Cell {cell}: {run}, {pace}{swapped}"), *lost, *tables)


def _live(watch: Watch, live: Live) -> None:
    """Show the table until Ctrl-C, which is the way to end it."""
    # Raised as an exception it could come while somebody else's code runs that has no use for it, and be lost.
    stop = StopFlag(signal.SIGINT)
    with live:
        while not stop:
            watch.read_for(SHOW_EVERY_S, stop)
            now = time.monotonic()
            live.update(view(watch.traffic, watch.cell.keys.cell, watch.cell.alive(), now), refresh=True)
            watch.traffic.mark(now)


def _keys(traffic: Traffic, now_s: float) -> Table:
    table = _table("key", "messages/s", "kB/s", "bad")
    for name, (rate, size) in traffic.rates(now_s).items():
        table.add_row(Text(name), f"{rate:.1f}", f"{size:.1f}", str(traffic.counts[name].bad or ""))
    return table


def _latencies(traffic: Traffic) -> Table:
    table = _table("latency", "median [us]", "p99 [us]", "decisions")
    for leg, latency in traffic.latency_us().items():
        cells = ("", "", "") if latency is None else (f"{latency[1]:.0f}", f"{latency[2]:.0f}", str(latency[0]))
        table.add_row(f"{leg}, {NOTES[leg]}", *cells)
    return table


def _services(traffic: Traffic, present: list[str], now_s: float) -> Table:
    table = _table("service", "handled/s", "refused", "heartbeat", "phase")
    for name in sorted({*traffic.hearts, *present}):
        row = _service(traffic.hearts.get(name), name in present, now_s)
        age_s = row["heartbeat_age_s"]
        cells = (row["handled_per_s"], row["refused"], "none yet" if age_s is None else f"{age_s} s ago", row["phase"])
        table.add_row(Text(name), *(Text("" if cell is None else str(cell)) for cell in cells))
    return table


def _service(heart: Heart | None, present: bool, now_s: float) -> dict[str, float | str | None]:
    """Return what is shown of one service."""
    if heart is None:
        return {"handled_per_s": None, "refused": None, "heartbeat_age_s": None, "phase": None}
    age_s, phase = round(now_s - heart.at_s, 1), heart.last.phase
    if age_s > HUNG_S:
        phase = "hung: here, but its heart stands still" if present else "gone"
    return {
        "handled_per_s": None if heart.handled_per_s is None else round(heart.handled_per_s),
        "refused": sum(heart.last.refused.values()),
        "heartbeat_age_s": age_s,
        "phase": phase,
    }


def _table(first: str, *others: str) -> Table:
    table = Table(min_width=60)
    table.add_column(first, no_wrap=True)
    for heading in others:
        table.add_column(heading, justify="left" if heading == "phase" else "right", no_wrap=True)
    return table
