"""A wheel in a fresh environment works in a folder whose files are called like modules of Python's and of ours."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
WORDS = ("--set", "limits.move_limit=25", "--episodes", "2", "--out")
MODULES = ("random", "queue", "token", "numpy", "socket")
PACKAGES = ("experiments", "services", "treenail")
SCRIPT = """
import treenail
print(len(treenail.run(treenail.load("initial", {"limits.move_limit": 25}), episodes=2).table()))
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the Python of an environment with nothing of ours but the wheel; what it needs is that of this one."""
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    source = folder / "source"
    source.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for name in ("treenail", "experiments", "services"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    build = [*pip, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder), str(source)]
    subprocess.run(build, check=True)
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / "venv"], check=True)
    made = folder / "venv" / "bin" / "python"
    (packages,) = (folder / "venv" / "lib").glob("python*/site-packages")
    install = [
        "install",
        "--no-deps",
        "--no-index",
        "--target",
        str(packages),
        *map(str, folder.glob("treenail-*.whl")),
    ]
    subprocess.run([*pip, *install], check=True)
    # Folders of libraries alone: the .pth files in them, such as that of an editable Treenail, are not followed.
    needs = [path for path in sys.path if Path(path, "msgspec").is_dir() or Path(path, "matplotlib").is_dir()]
    (packages / "needs.pth").write_text("\n".join(needs) + "\n")
    return made


@pytest.fixture
def unlucky(tmp_path: Path) -> Path:
    """Return a folder with a person's files that nobody asked Treenail to run."""
    for name in (*MODULES, *(f"{package}/__init__" for package in PACKAGES)):
        path = tmp_path / f"{name}.py"
        path.parent.mkdir(exist_ok=True)
        path.write_text("raise SystemExit('a file of the user was run')\n")
    return tmp_path


def run(python: Path, folder: Path, *words: str) -> str:
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "TREENAIL"))}
    done = subprocess.run(
        [python, *words], cwd=folder, env=environment, capture_output=True, text=True, timeout=170, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def script(python: Path) -> str:
    """Return the command as an installation puts it beside its Python."""
    command = python.with_name("runtreenail")
    command.write_text(f"#!{python}\nfrom treenail.__main__ import main\nmain()\n")
    return str(command)


def test_it_is_the_wheel_that_is_tried(python: Path, tmp_path: Path) -> None:
    where = "import treenail, services, experiments; print(*(m.__file__ for m in (treenail, services, experiments)))"
    for file in run(python, tmp_path, "-c", where).split():
        assert Path(file).is_relative_to(python.parents[1])


def test_commands_and_their_processes_run_ours_alone(python: Path, unlucky: Path) -> None:
    command = script(python)
    assert run(python, unlucky, command, "experiment", "list").startswith("chamfered")
    assert "results in here" in run(
        python, unlucky, command, "experiment", "run", "initial", "--seeds", "2", *WORDS, "here"
    )
    assert run(python, unlucky, "-P", "-m", "treenail", "experiment", "list").startswith("chamfered")
    shown = run(python, unlucky, command, "checkpoint", "show", "builtin", "--json")
    assert json.loads(shown)["episodes"] == 300, "the skill that comes with Treenail comes in the wheel"


def test_a_cell_runs_ours_alone(python: Path, unlucky: Path) -> None:
    ports = ("--port", "0", "--no-viewer")
    run(python, unlucky, script(python), "up", "sim", "--experiment", "initial", *ports, *WORDS, "cell")
    assert (unlucky / "cell" / "summary.json").exists()


def test_a_script_beside_packages_of_the_same_names_is_served(python: Path, unlucky: Path) -> None:
    for name in (*MODULES, "treenail/__init__"):  # what a script imports itself is its own affair
        (unlucky / f"{name}.py").unlink()
    (unlucky / "treenail").rmdir()
    (unlucky / "script.py").write_text(SCRIPT)
    assert run(python, unlucky, "script.py") == "2\n"
