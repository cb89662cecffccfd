"""Coverage-guided fuzzing by atheris, where it has a wheel: ``python -m experiments.fuzz.guided TARGET -runs=10000``.

What follows the target's name is libFuzzer's. Atheris follows the Python code of the readers; what msgspec, SQLite and
Zenoh do in machine code it does not see, which is why it is only the smaller part of a campaign.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

_FOLLOWED = ["services.wire", "services.agent", "services.store", "services.classifier.memory", "tomllib"]
"""Modules whose branches guide."""
_KERNEL = "services.classifier.art2_kernel"
"""Loaded before: numba cannot compile what atheris has put its own calls into."""
_FLAGS = ("-seed=1", "-max_len=8192", "-timeout=60", "-rss_limit_mb=1024", "-print_final_stats=1")
_RUNS = re.compile(r"stat::number_of_executed_units: (\d+)")
_COVERAGE = re.compile(r"cov: (\d+)")


@dataclass(frozen=True)
class Guided:
    """What came of one reader."""

    target: str
    inputs: int
    branches: tuple[int, int]
    """Python branches that were reached with the sound inputs alone, and in the end."""
    failure: str
    """The end of what it said if it found something; else empty."""


def available() -> bool:
    """Return whether atheris is installed: it has no wheel for some machines and versions of Python."""
    return find_spec("atheris") is not None


def run_all(inputs: int, only: str | None) -> Iterator[Guided]:
    """Yield what comes of ``inputs`` inputs for each reader of bytes (or ``only`` one), in a process of its own."""
    from experiments.fuzz.campaign import all_targets

    for target in all_targets():
        if target.of_bytes is not None and only in (None, target.name):
            yield _run(target.name, target.seeds, inputs)


def _run(name: str, seeds: Sequence[bytes], inputs: int) -> Guided:
    with tempfile.TemporaryDirectory(prefix="treenail-fuzz") as folder:
        for number, seed in enumerate(seeds):
            Path(folder, f"{number}").write_bytes(seed)
        flags = (*_FLAGS, f"-runs={inputs}", f"-artifact_prefix={folder}/finding-", folder)
        from services.rules.command_line import module_command  # not above: atheris wants to load services itself

        command = module_command("experiments.fuzz.guided", name, *flags)
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    said = done.stdout + done.stderr
    runs, reached = _RUNS.search(said), [int(found) for found in _COVERAGE.findall(said)] or [0]
    failure = "" if done.returncode == 0 and runs else said[-3000:]
    return Guided(name, int(runs[1]) if runs else 0, (reached[0], reached[-1]), failure)


def main() -> None:
    """Fuzz one reader until libFuzzer has enough; it ends the process."""
    atheris = import_module("atheris")
    import_module(_KERNEL)
    with atheris.instrument_imports(include=_FOLLOWED):
        from experiments.fuzz.campaign import all_targets
        from experiments.fuzz.target import outcome
    (target,) = (one for one in all_targets() if one.name == sys.argv[1])
    of_bytes = target.of_bytes
    assert of_bytes is not None, f"{target.name} does not read bytes"

    def read(data: bytes) -> None:
        outcome(target, of_bytes(data))

    atheris.Setup([sys.argv[0], *sys.argv[2:]], read)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
