"""Which code a result was computed by: a digest of what decides how a run goes.

A definition and a seed name a run only as long as the code stays the same. A result kept by older code would be a
number that nobody can compute again.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import cache
from importlib.resources import files

from experiments.bench.values import cpu_name
from services.wire.codec import contract_sha256
from services.wire.version import version

PACKAGES = ("services.agent", "services.classifier", "services.sim", "services.task")
"""Where the learners, the classifier, the contact world and the task are."""
SHELLS = ("__main__.py", "service.py")
"""Modules that join the others to the bus: no run in one process goes through them."""


@cache
def code_sha256(packages: Sequence[str] = PACKAGES) -> str:
    """Return the SHA-256, in hex, of the names and bytes of all modules of some packages, their shells aside."""
    digest = hashlib.sha256()
    for package in packages:
        modules = [file for file in files(package).iterdir() if file.name.endswith(".py") and file.name not in SHELLS]
        for module in sorted(modules, key=lambda file: file.name):
            digest.update(f"{package}/{module.name}\n".encode())
            digest.update(hashlib.sha256(module.read_bytes()).digest())
    return digest.hexdigest()


def origin(packages: Sequence[str] = PACKAGES) -> dict[str, str]:
    """Return what computed a page's numbers, where and when, by label; ``packages`` as for ``code_sha256``."""
    system = os.uname()
    return {
        "Treenail": f"version {version()}, contract {contract_sha256()[:12]}, code {code_sha256(tuple(packages))[:12]}",
        "machine": f"{cpu_name()}, {os.cpu_count()} cores, {system.sysname} {system.machine}",
        "Python": sys.version.split()[0],
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }
