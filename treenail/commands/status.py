"""``treenail status``: print who is alive in a cell, and how it goes."""

from __future__ import annotations

import argparse
import json
import textwrap
import time
from dataclasses import dataclass, field

import zenoh
from rich import box
from rich.table import Table
from rich.text import Text
from zenoh.handlers import Callback

from services.bus.inbox import HEARTBEAT_S
from services.cell import client
from services.cell.terminal import console
from services.rules.swaps import words
from services.wire.codec import contract_sha256
from services.wire.errors import ContractError, TreenailError
from services.wire.keys import ALIVE, EXPERIMENT, wild
from services.wire.messages import Alive, Experiment
from services.wire.text import one_line

LOOK_S = 1.2 * HEARTBEAT_S
"""How long is looked: every work loop that goes round beats in this time."""
ANSWER_WITHIN_S = 1.0
HEADINGS = ("service", "phase", "heartbeat", "msgs/s", "handled", "refused", "pid")
WHERE_THEY_DIFFER = ("run", "version", "contract", "host")
"""Shown in a column each when the services do not all say the same, else in a line for all."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("--json", action="store_true", help="as JSON")
    client.add_arguments(parser)


def act(arguments: argparse.Namespace) -> None:
    """Print a row a service; rates are measured over a good second."""
    with client.client_of(arguments) as cell:
        seen = look(cell)
    ours = contract_sha256()
    rows = [row(seen, name, ours) for name in seen.names]
    if arguments.json:
        experiment = seen.experiment
        found = {
            "cell": seen.cell,
            "contract": ours[:12],
            "experiment": None if experiment is None else experiment.definition.name,
            "seed": None if experiment is None else experiment.seed,
            "episodes": None if experiment is None else experiment.episodes,
            "episodes_done": None if experiment is None else experiment.episodes_done,
            "swaps": [] if experiment is None else [words(swap) for swap in experiment.swaps],
            "services": rows,
        }
        print(json.dumps(found))
        return
    console().print(table(title(seen), rows))
    for line in footnotes(rows):
        print(fitted(line, console().width))
    for swap in seen.experiment.swaps if seen.experiment is not None else ():
        print(f"swap {words(swap)}")
    if strangers := [str(row["service"]) for row in rows if row["contract_matches"] is False]:
        names = one_line(", ".join(strangers))
        print(f"another contract than this command's ({ours[:12]}): {names}; update them together, they cannot talk")


Row = dict[str, str | int | float | bool | None]


@dataclass
class Seen:
    """What was seen of a cell in a good second."""

    cell: str
    present: list[str] = field(default_factory=list)
    """Services that have said that they are alive."""
    before: dict[str, Alive] = field(default_factory=dict)
    after: dict[str, Alive] = field(default_factory=dict)
    between_s: float = LOOK_S
    beats: dict[str, float] = field(default_factory=dict)
    """Time since the last heartbeat [s], of those whose heart beat."""
    foreign: dict[str, str] = field(default_factory=dict)
    """Services whose answer is of another contract, with the error."""
    experiment: Experiment | None = None

    @property
    def names(self) -> list[str]:
        """Services of which there was any sign."""
        return sorted({*self.after, *self.present, *self.foreign})


def look(cell: client.Client) -> Seen:
    """Look at a cell. Raises NoAnswerError when nobody is there."""
    seen = Seen(cell.keys.cell)
    heard: dict[str, float] = {}

    def hear(sample: zenoh.Sample) -> None:
        heard[_service(str(sample.key_expr))] = time.monotonic()

    callback: Callback[zenoh.Sample] = Callback(hear, indirect=False)
    subscriber = cell.session.declare_subscriber(cell.keys.heartbeat("*"), callback)
    began = time.monotonic()
    seen.before, _ = _answers(cell)
    asked = time.monotonic()
    time.sleep(max(0.0, began + LOOK_S - asked))
    seen.between_s = time.monotonic() - asked
    seen.after, seen.foreign = _answers(cell)
    seen.present = cell.alive()
    now = time.monotonic()
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    seen.beats = {name: now - moment for name, moment in heard.items()}
    if not seen.names:
        raise cell.nobody()
    if "task" in seen.after:
        seen.experiment = _experiment(cell)
    return seen


def title(seen: Seen) -> str:
    """Return in a line which cell it is, and what runs there, how far."""
    experiment = seen.experiment
    if experiment is None:
        return f"Cell {seen.cell}"
    name, seed = experiment.definition.name, experiment.seed
    return f"Cell {seen.cell}: {name}, seed {seed}, episode {experiment.episodes_done} of {experiment.episodes}"


def row(seen: Seen, name: str, ours: str) -> Row:
    """Return what is shown of one service; None where it did not say."""
    age_s = seen.beats.get(name)
    here, earlier = seen.after.get(name), seen.before.get(name)
    shown: Row = {"service": name, "phase": _phase(seen, name)}
    shown |= {"heartbeat_age_s": None if age_s is None else round(age_s, 2)}
    if here is None:
        empty = ("messages/s", "handled", "refused", "refusals", "run", "version", "contract", "host", "pid")
        return {**shown, **dict.fromkeys(empty), "contract_matches": False if name in seen.foreign else None}
    same = earlier is not None and earlier.instance == here.instance
    return {
        **shown,
        "messages/s": round((here.handled - earlier.handled) / seen.between_s) if same and earlier else None,
        "handled": here.handled,
        "refused": sum(here.refused.values()),
        "refusals": ", ".join(f"{count} {error}" for error, count in sorted(here.refused.items())),
        "run": here.run,
        "version": here.version,
        "contract": here.contract_sha256[:12],
        "host": here.host,
        "pid": here.pid,
        "contract_matches": here.contract_sha256 == ours,
    }


def _phase(seen: Seen, name: str) -> str:
    here = seen.after.get(name)
    if name in seen.foreign:
        return f"speaks another contract: {seen.foreign[name]}"
    if here is None:
        return "hung: here, but not answering"
    return here.phase if name in seen.present else f"not ready: {here.phase}"


def table(heading: str, rows: list[Row]) -> Table:
    """Return the rows for people: at 80 columns none is broken, except in its phase, while the services agree."""
    made = Table(title=Text(heading), box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    headings = (*HEADINGS, *(name for name in WHERE_THEY_DIFFER if len(_values_of(rows, name)) > 1))
    for name in headings:
        number = name in ("msgs/s", "handled", "refused", "pid")
        made.add_column(name, justify="right" if number else "left", overflow="fold", no_wrap=name != "phase")
    for row in rows:
        age_s = row["heartbeat_age_s"]
        contract = f"{row['contract'] or ''}{' (differs)' if row['contract_matches'] is False else ''}"
        shown = {
            **row,
            "heartbeat": f"none in {LOOK_S:.1f} s" if age_s is None else f"{age_s} s ago",
            "msgs/s": row["messages/s"],
            "contract": contract.strip(),
        }
        cells = ("" if shown[name] is None else str(shown[name]) for name in headings)
        bad = row["contract_matches"] is not True or age_s is None
        made.add_row(*(Text(one_line(cell)) for cell in cells), style="red" if bad else None)
    return made


def footnotes(rows: list[Row]) -> list[str]:
    """Return in lines what all services say alike, and what was refused by each."""
    alike = [f"{name} {said[0]}" for name in WHERE_THEY_DIFFER if len(said := _values_of(rows, name)) == 1]
    lines = [f"all: {one_line(', '.join(alike))}"] if alike else []
    return lines + [one_line(f"refused by {row['service']}: {row['refusals']}") for row in rows if row["refusals"]]


def fitted(line: str, width: int) -> str:
    """Return a line broken between words to fit so many columns; what goes on is set in."""
    return textwrap.fill(line, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def _values_of(rows: list[Row], name: str) -> list[str]:
    """Return the different values that services say of something; who says nothing does not count."""
    return sorted({str(row[name]) for row in rows if row[name] is not None})


def _answers(cell: client.Client) -> tuple[dict[str, Alive], dict[str, str]]:
    """Return what the services say of themselves, and the errors of those whose answer is of another contract."""
    samples, _ = cell.replies(wild(ALIVE), ANSWER_WITHIN_S)
    alive: dict[str, Alive] = {}
    foreign: dict[str, str] = {}
    for sample in samples:
        name = _service(str(sample.key_expr))
        try:
            alive[name] = cell.message(sample, Alive)
        except ContractError as error:
            foreign[name] = str(error)
    return alive, foreign


def _experiment(cell: client.Client) -> Experiment | None:
    try:
        return cell.ask(EXPERIMENT, Experiment, ANSWER_WITHIN_S)
    except TreenailError:  # a task that has just gone, or of another contract: its row says so
        return None


def _service(key: str) -> str:
    return key.rpartition("/")[2]
