"""``bench all``: every benchmark once, and short, each in a process of its own; what they say in one table.

A benchmark that fails or finds no time is a row that says so: to measure is all that is done here.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from experiments.bench.values import Value
from services.rules.command_line import module_command
from services.wire.text import one_line

WITHIN_S = 590.0
"""For all of them; what has not begun by then is left out."""


class Part(NamedTuple):
    """One benchmark as it is run here."""

    name: str
    options: tuple[str, ...]
    about_s: float
    """What it takes on two cores that do nothing else."""
    benchmark: str = ""
    """Which benchmark it is, where it is called something else here."""


class Figure(NamedTuple):
    """One row of the table."""

    words: str
    unit: str
    part: str
    path: tuple[str | int, ...]
    """Where it stands in the benchmark's results."""


PARTS = (
    Part("sim", ("--moves", "500", "--episodes", "10"), 25),
    Part("square", ("--experiment", "square-q-softmax", "--moves", "500", "--episodes", "10"), 25, "sim"),
    Part("art2", ("--steps", "2000"), 10),
    Part("learner", (), 5),
    Part("env", ("--rounds", "2"), 15),
    Part("link", ("--messages", "1000", "--moves", "300"), 15),
    Part("scale", (), 3),
    Part("loop", ("--episodes", "12", "--together"), 110),
    Part("query", ("--seconds", "3", "--rounds", "2"), 60),
    Part("start", ("--rounds", "2"), 25),
    Part("fleet", ("--cells", "1,2", "--episodes", "12"), 60),
    Part("classifiers", ("--vectors", "300", "--episodes", "10", "--rounds", "1"), 40),
    Part("cluster", ("--runs", "2", "--episodes", "5", "--rounds", "1"), 30),
    Part("viewer", ("--minutes", "1"), 75),
    Part("soak", ("--minutes", "0.75"), 60),
)
FIGURES = (
    Figure("moves in free air", "1/s", "sim", ("free_moves_per_s",)),
    Figure("moves in contact", "1/s", "sim", ("contact_moves_per_s",)),
    Figure("moves in contact: a bare SAPIEN loop", "1/s", "sim", ("bare_sapien_moves_per_s",)),
    Figure("moves in contact: a bare MuJoCo loop", "1/s", "sim", ("bare_mujoco_moves_per_s",)),
    Figure("motions of whole episodes", "1/s", "sim", ("episode_motions_per_s",)),
    Figure("moves in contact, square peg", "1/s", "square", ("contact_moves_per_s",)),
    Figure("moves in contact, square peg: a bare SAPIEN loop", "1/s", "square", ("bare_sapien_moves_per_s",)),
    Figure("moves in contact, square peg: a bare MuJoCo loop", "1/s", "square", ("bare_mujoco_moves_per_s",)),
    Figure("motions of whole episodes, square peg", "1/s", "square", ("episode_motions_per_s",)),
    Figure("ART2: classify and learn, 6 inputs, 20 classes", "1/s", "art2", ("cases", 0, "classifications_per_s")),
    Figure("ART2: the same, 12 inputs", "1/s", "art2", ("cases", 1, "classifications_per_s")),
    Figure("table: updates", "1/s", "learner", ("updates_per_s",)),
    Figure("table: one decision, learning included", "us", "learner", ("decide_median_us",)),
    Figure("the Gymnasium environment: steps", "1/s", "env", ("steps_per_s", "treenail/PegInHole-v0, listed moves")),
    Figure("a decision: physics", "us", "loop", ("physics_us",)),
    Figure("a decision: in one process", "us", "loop", ("in_process_us",)),
    Figure("a decision: its bare messages", "us", "loop", ("bare_chain_us",)),
    Figure("a decision: the cell", "us", "loop", ("distributed_us",)),
    Figure("a decision: (cell - physics) / bare messages", "", "loop", ("ratio",)),
    Figure("decisions in one process", "1/s", "loop", ("in_process_decisions_per_s",)),
    Figure("decisions of the cell", "1/s", "loop", ("distributed_decisions_per_s",)),
    Figure("a decision: the cell, four services in one process", "us", "loop", ("together_us",)),
    Figure("decisions of the cell, four services in one process", "1/s", "loop", ("together_decisions_per_s",)),
    Figure("question by state, p99, while it learns", "ms", "query", ("by_state", "p99_ms")),
    Figure("question by F/T, p99, while it learns", "ms", "query", ("by_ft", "p99_ms")),
    Figure("from the command to the first episode", "s", "start", ("first_episode_s",)),
    Figure("viewer: processor", "% of a core", "viewer", ("cpu_percent",)),
    Figure("F/T stream of 8 kHz, p99", "ms", "soak", ("ft_stream", "latency_p99_ms")),
)


def measure(say: Callable[[str], None], within_s: float = WITHIN_S) -> dict[str, Value]:
    """Run all parts, as far as there is time for, and return their results by name; ``say`` is told how it goes."""
    results: dict[str, Value] = {}
    began = time.monotonic()
    for number, part in enumerate(PARTS):
        left_s = within_s - (time.monotonic() - began)
        still_s = min(left_s, sum(later.about_s for later in PARTS[number:]))
        say(f"{part.name} ({number + 1} of {len(PARTS)}, about {max(still_s, 0) / 60:.0f} min left)")
        results[part.name] = _run(part, left_s) if left_s >= part.about_s else {"left_out": "there was no time for it"}
    return {"parts": results, "table": table(results), "seconds": round(time.monotonic() - began, 1)}


def table(results: Mapping[str, Value]) -> list[Value]:
    """Return the rows of the table: what, unit, and median, least and greatest, or why there is none."""
    return [_row(figure, results.get(figure.part)) for figure in FIGURES]


def _run(part: Part, within_s: float) -> dict[str, Value]:
    """Return the results of one benchmark, or what became of it."""
    command = module_command("treenail.__main__", "bench", part.benchmark or part.name, "--json", *part.options)
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=within_s, check=False)
        results: dict[str, Value] = json.loads(done.stdout)["results"]
    except subprocess.TimeoutExpired:
        return {"left_out": f"not done within {within_s:.0f} s"}
    except (json.JSONDecodeError, KeyError):
        return {"left_out": one_line(done.stderr.strip().rpartition("\n")[2] or f"exit status {done.returncode}")}
    return results


def _row(figure: Figure, part: Any) -> Value:
    """Return a figure as it stands in the results of its benchmark, which are maps and lists of what JSON has."""
    value = part
    try:
        for step in figure.path:
            value = value[step]
    except (IndexError, KeyError, TypeError):
        left_out = part.get("left_out") if isinstance(part, Mapping) else None
        return {"what": figure.words, "left_out": left_out or "not measured"}
    if isinstance(value, str):
        return {"what": figure.words, "left_out": value}
    if isinstance(value, Mapping):
        return {"what": figure.words, "unit": figure.unit, **value}
    return {"what": figure.words, "unit": figure.unit, "median": value, "min": value, "max": value}


def lines(report: Mapping[str, Any]) -> list[str]:
    """Return the table as text, with the machine above it."""
    machine, rows = report["machine"], report["results"]["table"]
    width = max(len(row["what"]) for row in rows)
    said = [f"{machine['cpu']}, {machine['usable_cores']} cores, load {machine['load_1min']}", ""]
    for row in rows:
        if "left_out" in row:
            said.append(f"{row['what']:<{width}}  {row['left_out']}")
        else:
            spread = f"({row['min']:.4g} to {row['max']:.4g})" if row["min"] != row["max"] else ""
            said.append(f"{row['what']:<{width}}  {row['median']:>9.4g} {row['unit']}  {spread}".rstrip())
    return said


def to_stderr(text: str) -> None:
    """Say on standard error which part is being run."""
    print(f"bench all: {text}", file=sys.stderr, flush=True)
