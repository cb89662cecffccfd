"""What benchmarks hand back: medians with their spread, and the machine they were measured on."""

from __future__ import annotations

import os
import platform
import statistics
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TypeAlias

from services.wire.version import version as own_version

Value: TypeAlias = "int | float | str | bool | Mapping[str, Value] | Sequence[Value]"
"""What a report is made of; every measured number has its unit at the end of its name."""

LIBRARIES = ("eclipse-zenoh", "msgspec", "numba", "numpy", "sapien")


def spread(values: Sequence[float]) -> dict[str, float]:
    """Return median, least and greatest of one or more values that were measured alike."""
    return {"median": statistics.median(values), "min": min(values), "max": max(values)}


def machine() -> dict[str, Value]:
    """Return what the figures depend on beside the program."""
    return {
        "cpu": cpu_name(),
        "cores": os.cpu_count() or 1,
        "usable_cores": len(os.sched_getaffinity(0)),
        "load_1min": round(os.getloadavg()[0], 2),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "python": sys.version.split()[0],
        "versions": {"treenail": own_version(), **{name: version(name) for name in LIBRARIES}},
    }


def cpu_name() -> str:
    """Return the processor's name, or its architecture where Linux does not say more."""
    try:
        lines = Path("/proc/cpuinfo").read_text(errors="replace").splitlines()
    except OSError:
        return platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
