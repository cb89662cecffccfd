"""``treenail runs``: which runs a folder has, how large they are, and what can go."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from rich.table import Table

from experiments.lab.result_files import DEFINITION, SUMMARY
from services.cell.terminal import console
from services.rules.command_line import number
from services.wire.errors import TreenailError
from services.wire.text import one_line

STORE = "store.sqlite"
LOGS = "logs"
DAY_S = 86_400.0
DEEP = 3
"""Folders below the one that is listed that are looked into."""


class Found(NamedTuple):
    """A folder with a run."""

    path: Path
    experiment: str
    seeds: str
    episodes: str
    bytes: int
    changed_s: float
    """When something in it was written last, seconds since 1970."""
    finished: bool
    """Whether it has a whole ``summary.json``."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    commands = parser.add_subparsers(dest="do", metavar="DO", required=True)
    listing = commands.add_parser("list", help="list runs and their sizes")
    clean = commands.add_parser("clean", help="remove runs; without --yes only say which")
    for command in (listing, clean):
        command.add_argument("--folder", type=Path, default=Path("runs"), metavar="FOLDER", help="where runs are")
    listing.add_argument("--json", action="store_true", help="as JSON")
    clean.add_argument("run", nargs="*", type=Path, metavar="RUN", help="folders of runs (default: all in FOLDER)")
    clean.add_argument("--older", type=number(0, 36500), metavar="DAYS", help="only what was written longer ago")
    clean.add_argument("--unfinished", action="store_true", help="only runs that came to no results")
    clean.add_argument("--yes", action="store_true", help="do it")


def act(arguments: argparse.Namespace) -> None:
    """List, or remove."""
    if arguments.do == "list":
        _list(arguments)
    else:
        _clean(arguments)


def _list(arguments: argparse.Namespace) -> None:
    there = sorted(runs_in(arguments.folder), key=lambda run: -run.changed_s)
    if arguments.json:
        print(json.dumps([{**run._asdict(), "path": str(run.path)} for run in there], indent=2))
        return
    if not there:
        print(f"{arguments.folder}: no runs")
        return
    table = Table(box=None, pad_edge=False)
    table.add_column("run", overflow="fold")
    for heading in ("seeds", "episodes", "size", "written"):
        table.add_column(heading, justify="right", no_wrap=True)
    now = time.time()
    for run in there:
        episodes = run.episodes if run.finished else "unfinished"
        table.add_row(one_line(str(run.path)), run.seeds, episodes, size(run.bytes), age(now - run.changed_s))
    console().print(table)
    print(f"{len(there)} runs, {size(sum(run.bytes for run in there))}; treenail runs clean removes")


def _clean(arguments: argparse.Namespace) -> None:
    chosen = [_run(path) for path in arguments.run] if arguments.run else list(runs_in(arguments.folder))
    now = time.time()
    if arguments.older is not None:
        chosen = [run for run in chosen if now - run.changed_s > arguments.older * DAY_S]
    if arguments.unfinished:
        chosen = [run for run in chosen if not run.finished]
    for run in chosen:
        _refuse_while_in_use(run.path)
    for run in chosen:
        if arguments.yes:
            shutil.rmtree(run.path)
        print(f"{'removed' if arguments.yes else 'would remove'} {run.path}, {size(run.bytes)}")
    total = size(sum(run.bytes for run in chosen))
    print(f"{len(chosen)} runs, {total}" + ("" if arguments.yes or not chosen else "; with --yes they go"))


def runs_in(folder: Path) -> Iterator[Found]:
    """Give the runs in a folder and in those below it. Raises TreenailError when there is no folder."""
    if not folder.is_dir():
        raise TreenailError(f"{folder}: expected a folder with runs, got none")
    for root, folders, names in os.walk(folder):
        path = Path(root)
        if is_run(names):
            folders.clear()
            yield found(path)
        elif len(path.relative_to(folder).parts) >= DEEP:
            folders.clear()


def is_run(names: list[str]) -> bool:
    """Return whether files of these names make a run: results, or the store of a cell."""
    return STORE in names or {SUMMARY, DEFINITION} <= set(names)


def found(path: Path) -> Found:
    """Return what there is to know about a run's folder, whatever state it is in."""
    sizes, times = 0, [path.stat().st_mtime]
    for root, _, names in os.walk(path):
        for name in names:
            with suppress(OSError):  # gone in the meantime
                status = Path(root, name).lstat()
                sizes += status.st_size
                times.append(status.st_mtime)
    told = _summary(path)
    made = told.get("runs", [])
    seeds = ",".join(str(run["seed"]) for run in made) if len(made) <= 3 else f"{len(made)} of them"
    episodes = str(max((run["episodes"] for run in made), default=0))
    return Found(path, str(told.get("experiment", "")), seeds, episodes, sizes, max(times), bool(made))


def _summary(path: Path) -> dict[str, Any]:
    try:
        told = json.loads((path / SUMMARY).read_bytes())
        return told if all({"seed", "episodes"} <= set(run) for run in told["runs"]) else {}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _run(path: Path) -> Found:
    if not path.is_dir() or path.is_symlink() or not is_run(os.listdir(path)):
        raise TreenailError(
            f"{path}: expected the folder of a run, with {STORE} or {SUMMARY}, got none; nothing is gone"
        )
    return found(path)


def _refuse_while_in_use(path: Path) -> None:
    """Raise TreenailError when a process has the run's store open."""
    store = path / STORE
    if not store.exists():
        return
    here = store.resolve()
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        with suppress(OSError):
            if link.resolve() == here:
                pid = link.parts[2]
                raise TreenailError(f"{path}: expected nobody to use it, process {pid} does; nothing is gone")


def size(count: int) -> str:
    """Return bytes in words, powers of 1000."""
    value, unit = float(count), "B"
    for unit in ("B", "kB", "MB", "GB", "TB"):
        if value < 1000 or unit == "TB":
            break
        value /= 1000
    return f"{value:.0f} {unit}" if unit == "B" else f"{value:.1f} {unit}"


def age(seconds: float) -> str:
    """Return how long ago, in words."""
    for length, unit in ((DAY_S, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= length:
            return f"{seconds / length:.0f} {unit} ago"
    return "just now"
