"""docs/performance.md: what ``bench all`` measured last, and before; all of it stands in docs/performance.json."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeAlias

from experiments.bench.every import FIGURES
from experiments.bench.values import Value

Entry: TypeAlias = "dict[str, Any]"
"""One measurement: commit, date, machine, seconds, table."""

NAME = "performance"
MOST = 40
"""Measurements that are kept."""
_COLUMNS = (
    "moves in contact",
    "ART2: classify and learn, 6 inputs, 20 classes",
    "table: one decision, learning included",
    "a decision: its bare messages",
    "a decision: the cell",
    "a decision: (cell - physics) / bare messages",
    "from the command to the first episode",
)
"""Rows that the history shows."""


def write(folder: Path, report: Mapping[str, Value]) -> Path:
    """Add a report of ``bench all`` to the history in a folder, and return the page made anew from it."""
    history = folder / f"{NAME}.json"
    entries: list[Entry] = json.loads(history.read_text()) if history.exists() else []
    entries = [*entries, entry(report)][-MOST:]
    history.write_text(json.dumps(entries, indent=1) + "\n")
    made = folder / f"{NAME}.md"
    made.write_text(page(entries))
    return made


def entry(report: Mapping[str, Any]) -> Entry:
    """Return what is kept of a report."""
    results = report["results"]
    return {
        "commit": commit(),
        "date": datetime.now(UTC).date().isoformat(),
        "machine": report["machine"],
        "seconds": results["seconds"],
        "table": results["table"],
    }


def commit() -> str:
    """Return the commit that these files are of, with a ``+`` when they are not all as it has them."""
    here = Path(__file__).parent
    try:
        name = subprocess.run(
            ["git", "describe", "--always", "--dirty=+"], cwd=here, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return name.stdout.strip()


def page(entries: Sequence[Entry]) -> str:
    """Return the page for a history, which has at least one measurement."""
    newest = entries[-1]
    machine = newest["machine"]
    text = [
        "# How fast it is",
        "",
        "Made by `make performance`, which runs `treenail bench all` and adds to `performance.json`; not to be edited.",
        "Nothing here is a promise: a benchmark measures and never fails. What a busy machine does to times it does to",
        "all of them, so compare within a measurement, and mind the load.",
        "",
        f"Measured on {newest['date']} at commit {newest['commit']}, in {newest['seconds'] / 60:.0f} minutes:",
        f"{machine['cpu']}, {machine['usable_cores']} cores, load {machine['load_1min']} at the beginning, Python",
        f"{machine['python']}, " + ", ".join(f"{name} {number}" for name, number in machine["versions"].items()) + ".",
        "",
        "| what | median | least | greatest | unit |",
        "|---|---|---|---|---|",
        *(_line(row) for row in newest["table"]),
        "",
        "## Before",
        "",
        "| date | commit | load | "
        + " | ".join(f"{name} [{_unit(name)}]".replace(" []", "") for name in _COLUMNS)
        + " |",
        "|---|---|---|" + "---|" * len(_COLUMNS),
        *(_past(one) for one in reversed(entries)),
    ]
    return "\n".join(text) + "\n"


def _line(row: Mapping[str, Any]) -> str:
    if "left_out" in row:
        return f"| {row['what']} | {row['left_out']} | | | |"
    numbers = " | ".join(f"{row[key]:.4g}" for key in ("median", "min", "max"))
    return f"| {row['what']} | {numbers} | {row['unit']} |"


def _past(one: Entry) -> str:
    medians = {row["what"]: f"{row['median']:.4g}" for row in one["table"] if "median" in row}
    cells = [
        one["date"],
        one["commit"],
        str(one["machine"]["load_1min"]),
        *(medians.get(name, "") for name in _COLUMNS),
    ]
    return f"| {' | '.join(cells)} |"


def _unit(words: str) -> str:
    return next(figure.unit for figure in FIGURES if figure.words == words)
