"""Services never import each other: looked up in fresh interpreters, and by import-linter."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SERVICES = (
    "agent",
    "classifier",
    "cli",
    "robot_link",
    "router",
    "sensor_jr3",
    "sim",
    "store",
    "task",
    "viewer",
)
LOOK = """
import importlib, sys
for name in sys.argv[2:]:
    importlib.import_module(name)
ours = {name for name in sys.modules if name.split(".")[0] in ("services", "experiments")}
own = ("services." + sys.argv[1], "services.wire")
print(*sorted(name for name in ours if name != "services" and not (name + ".").startswith(tuple(o + "." for o in own))))
"""


def modules_of(service: str) -> list[str]:
    """Return all modules of a service but ``__main__``, in a fixed order."""
    folder = ROOT / "services" / service
    found = []
    for path in sorted(folder.rglob("*.py")):
        parts = list(path.relative_to(ROOT).with_suffix("").parts)
        if parts[-1] == "__main__":
            continue
        found.append(".".join(parts[:-1] if parts[-1] == "__init__" else parts))
    return found


def others_seen_by(service: str, modules: list[str]) -> str:
    """Import modules of a service in a fresh interpreter; return all of ours that came along but itself and wire."""
    done = subprocess.run(
        [sys.executable, "-c", LOOK, service, *modules], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_every_service_is_looked_at() -> None:
    packages = {path.parent.name for path in (ROOT / "services").glob("*/__init__.py")}
    assert packages - {"wire"} == set(SERVICES)


@pytest.mark.parametrize("service", SERVICES)
def test_a_service_sees_no_other(service: str) -> None:
    modules = modules_of(service)
    assert f"services.{service}" in modules
    seen = others_seen_by(service, modules).split()
    if service == "cli":  # it draws what the experiments measured; by what they import it must see no service either
        seen = [name for name in seen if name.split(".")[0] != "experiments"]
    assert seen == []


def test_the_ground_floor_sees_no_service() -> None:
    assert others_seen_by("wire", modules_of("wire")) == ""


def test_a_wall_with_a_hole_would_be_noticed() -> None:
    assert others_seen_by("agent", ["services.agent", "services.task.rewards"]) == "services.task services.task.rewards"


def test_import_linter_is_content() -> None:
    assert importlib.util.find_spec("importlinter") is not None
    code = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    done = subprocess.run(
        [sys.executable, "-c", code, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Contracts: 3 kept, 0 broken." in done.stdout
