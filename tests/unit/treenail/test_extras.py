"""Without any extra Treenail asks a cell; what needs more says in one line which extra has it."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib.metadata import distributions, packages_distributions
from pathlib import Path

import pytest

from services.rules.command_line import EXTRAS

ROOT = Path(__file__).resolve().parents[3]
BLOCKED = """
import runpy, sys
for name in {blocked}:
    sys.modules[name] = None
sys.argv[1:] = {words}
runpy.run_module({module!r}, run_name="__main__", alter_sys=True)
"""
NOBODY = ("--connect", "unixsock-stream/nowhere", "--connect-timeout", "0.1")


def project() -> dict[str, list[str]]:
    """Return what each extra of pyproject.toml installs, names in lower case, and as "" what is always there."""
    told = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = {"": told["dependencies"], **told["optional-dependencies"]}
    return {name: [re.split(r"[>=;\[ ]", need)[0].lower() for need in needs] for name, needs in extras.items()}


def without_extras(module: str, *words: str) -> tuple[int, str]:
    """Run a module of ours where no extra is installed; return its status and the one line that it said."""
    code = BLOCKED.format(blocked=sorted(EXTRAS), words=list(words), module=module)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert len(done.stderr.splitlines()) <= 1, done.stderr
    return done.returncode, done.stderr


@pytest.mark.parametrize("module", sorted(EXTRAS))
def test_the_extra_that_is_named_has_the_module(module: str) -> None:
    names = packages_distributions().get(module) or [
        one.name for one in distributions() if any(str(file).split(".")[0] == module for file in one.files or ())
    ]
    assert {name.lower().replace("_", "-") for name in names} & set(project()[EXTRAS[module]])


def test_every_extra_is_named_and_one_has_them_all() -> None:
    pyproject = (ROOT / "pyproject.toml").read_text()
    own = set(project()) - {"", "all", "dev"}
    assert set(EXTRAS.values()) == own
    listed = re.search(r'^all = \["treenail\[(.*)\]"\]$', pyproject, re.MULTILINE)
    assert listed is not None and set(listed[1].split(",")) == own


@pytest.mark.parametrize(
    "words",
    [
        ("status", *NOBODY),
        ("get", "agent/q_table", *NOBODY),
        ("q-table", *NOBODY),
        ("policy", "--state", "1", *NOBODY),
        ("top", *NOBODY),
        ("swap", "learner", "--set", "alpha=0.2", *NOBODY),
    ],
)
def test_what_asks_a_cell_needs_no_extra(words: tuple[str, ...]) -> None:
    status, line = without_extras("treenail", *words)
    assert status == 2
    assert line.startswith(f"treenail {words[0]}: ") and "module" not in line, "it got as far as the cell"


@pytest.mark.parametrize("words", [(), ("--version",), ("experiment", "list"), ("experiment", "show", "initial")])
def test_what_needs_no_cell_either_just_works(words: tuple[str, ...]) -> None:
    assert without_extras("treenail", *words) == (0, "")


@pytest.mark.parametrize(
    ("module", "words", "extra"),
    [
        ("treenail", ("experiment", "run", "initial", "--out", "nowhere"), "cli"),
        ("treenail", ("certs", "--out", "nowhere"), "cli"),
        ("treenail", ("oracle", "initial", "--beam", "1", "--attempts", "0"), "sim"),
        ("treenail", ("replay", *NOBODY), "classifier"),
        ("treenail", ("diff", *NOBODY), "classifier"),
        ("treenail", ("bench", "sim"), "sim"),
        ("treenail", ("reproduce", "--out", "nowhere"), "reproduce"),
        ("treenail", ("leaderboard", "--out", "nowhere"), "cli"),
        ("treenail", ("compare", "nowhere"), "cli"),
        ("treenail", ("pterm", "/dev/null"), "robot_link"),
        ("treenail", ("pfloppy", "/dev/null", "."), "robot_link"),
        ("services.viewer", NOBODY, "viewer"),
        ("services.sim", NOBODY, "sim"),
        ("services.ros2.out", NOBODY, "ros2"),
        ("services.ros2.robot", (*NOBODY, "--target", "/a", "--pose", "/b", "--frame", "a"), "ros2"),
        ("services.ros2.sensor", (*NOBODY, "--topic", "/a", "--frame", "a"), "ros2"),
        ("services.classifier", NOBODY, "classifier"),
    ],
)
def test_a_missing_extra_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, words: tuple[str, ...], extra: str
) -> None:
    monkeypatch.chdir(tmp_path)
    status, line = without_extras(module, *words)
    assert (status, f"pip install '.[{extra}]'" in line) == (2, True), line
    assert list(tmp_path.iterdir()) == [], "nothing is begun that cannot be finished"
