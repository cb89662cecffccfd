"""What benchmarks read of running processes: memory and processor time, and whether a figure grows with time."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from services.cell.supervisor import Supervisor, last_line
from services.wire.errors import CellError

MB = 1e6


class Usage(NamedTuple):
    """What a process takes."""

    rss_bytes: int
    cpu_s: float
    """Processor time so far, all threads."""


def usage(pid: int, name: str = "a process") -> Usage:
    """Return what a process takes now. Raises CellError, with its name, when there is none of that number."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        # After the name, which may hold anything: state is field 3, processor time in user and system mode 14 and 15.
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        pages = 0
    if pages == 0:  # one that has ended but was not waited for has no memory any more
        raise CellError(f"bench: expected {name} ({pid}) to run, it has ended")
    cpu_s = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return Usage(pages * os.sysconf("SC_PAGE_SIZE"), cpu_s)


def usages(supervisor: Supervisor, others: Mapping[str, int] | None = None) -> dict[str, Usage]:
    """Return what each process takes, by service; ``others`` are more process ids by name.

    Raises CellError when one has ended.
    """
    mind(supervisor)
    of_others = {name: usage(pid, name) for name, pid in (others or {}).items()}
    return {
        child.name: usage(child.process.pid) for child in supervisor.children.values() if child.process is not None
    } | of_others


def mind(*supervisors: Supervisor) -> None:
    """Raise CellError when a process has ended: what it had taken is gone with it."""
    for supervisor in supervisors:
        running = supervisor.alive()
        for child in supervisor.children.values():
            if child.name not in running:
                raise CellError(f"bench: expected {child.name} to run, it ended: {last_line(child.log)}")


def slope_per_h(times_s: Sequence[float], values: Sequence[float]) -> float:
    """Return by how much values grow in an hour, by least squares; 0 for fewer than two different times."""
    if len(set(times_s)) < 2:
        return 0.0
    hours = np.array(times_s) / 3600
    centred = hours - hours.mean()
    return float(centred @ np.array(values) / (centred @ centred))


def total(parts: Iterable[Usage]) -> Usage:
    """Return what some processes take together."""
    processes = list(parts)
    return Usage(sum(part.rss_bytes for part in processes), sum(part.cpu_s for part in processes))
