"""Which code a result was computed by: a digest of what decides how a run goes.

A definition and a seed name a run only as long as the code stays the same. A result kept by older code would be a
number that nobody can compute again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import cache
from importlib.resources import files

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
