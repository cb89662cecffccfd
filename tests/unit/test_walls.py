"""The floors of the house: nobody looks up, no service sees another. In fresh interpreters, and by import-linter."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FLOORS = ("services.wire", "services.rules", "services.bus")
"""From the ground up; the services stand on all three."""
SERVICES = sorted(
    path.parent.name
    for path in (ROOT / "services").glob("*/__init__.py")
    if f"services.{path.parent.name}" not in FLOORS
)
LOOK = """
import importlib, sys
for name in sys.argv[2:]:
    importlib.import_module(name)
ours = {name for name in sys.modules if name.split(".")[0] in ("services", "experiments", "treenail")}
own = tuple(part + "." for part in sys.argv[1].split(","))
print(*sorted(name for name in ours if name != "services" and not (name + ".").startswith(own)))
"""


def modules_of(package: str) -> list[str]:
    """Return all modules of a package but ``__main__``, in a fixed order."""
    found = []
    for path in sorted((ROOT / Path(*package.split("."))).rglob("*.py")):
        parts = list(path.relative_to(ROOT).with_suffix("").parts)
        if parts[-1] != "__main__":
            found.append(".".join(parts[:-1] if parts[-1] == "__init__" else parts))
    return found


def others_seen_by(allowed: tuple[str, ...], modules: list[str]) -> str:
    """Import modules in a fresh interpreter; return all of ours that came along but the packages that may."""
    done = subprocess.run(
        [sys.executable, "-c", LOOK, ",".join(allowed), *modules], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_there_are_services() -> None:
    assert {"agent", "cell", "sim", "task"} <= set(SERVICES)


@pytest.mark.parametrize("service", SERVICES)
def test_a_service_sees_no_other(service: str) -> None:
    modules = modules_of(f"services.{service}")
    assert f"services.{service}" in modules
    assert others_seen_by((f"services.{service}", *FLOORS), modules) == ""


@pytest.mark.parametrize("height", range(len(FLOORS)))
def test_a_floor_sees_only_what_is_below(height: int) -> None:
    assert others_seen_by(FLOORS[: height + 1], modules_of(FLOORS[height])) == ""


def test_a_wall_with_a_hole_would_be_noticed() -> None:
    seen = others_seen_by(("services.agent", *FLOORS), ["services.agent", "services.task.rewards"])
    assert seen == "services.task services.task.rewards"


def test_import_linter_is_content() -> None:
    assert importlib.util.find_spec("importlinter") is not None
    code = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    done = subprocess.run(
        [sys.executable, "-c", code, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 broken." in done.stdout
