"""The examples of docs/python.md run as they stand, in a script without a guard, beside files of unlucky names."""

from __future__ import annotations

import csv
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import treenail

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "python.md").read_text()
EXAMPLES = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Return the folder that the examples ran in and what they printed."""
    folder = tmp_path_factory.mktemp("notes")
    for name in ("experiments", "services"):
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text("raise SystemExit('a file of the user was run')\n")
    (folder / "script.py").write_text("print('once')\n" + "\n".join(EXAMPLES))
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=folder, capture_output=True, text=True, timeout=170, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    return folder, done.stdout


def test_the_examples_print_what_they_say(ran: tuple[Path, str]) -> None:
    once, seed_0, seed_1, row, learnt = ran[1].splitlines()
    assert once == "once", "the processes do not run the script again"
    for seed, line in enumerate((seed_0, seed_1)):
        assert re.fullmatch(rf"seed {seed}: return -[\d.]+, mean force \d\.\d\d N, [a-z_]+", line)
    assert row.startswith("{'seed': 0, 'episode': 0, 'outcome': '") and "'mean_force_n': " in row
    assert learnt.startswith("4 ") and "+X" in learnt


def test_what_they_write_is_what_the_command_writes(ran: tuple[Path, str]) -> None:
    results = ran[0] / "results"
    names = {"summary.json", "episodes.csv", "definition.toml", "seed0.skill", "seed1.skill", "return.png"}
    assert names <= {path.name for path in results.iterdir()}
    with (results / "episodes.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["seed"], row["episode"]) for row in rows] == [(str(seed), str(n)) for seed in (0, 1) for n in range(4)]
    assert json.loads((results / "summary.json").read_text())["experiment"] == "chamfered-q-softmax"
    assert treenail.read_skill(results / "seed0.skill") == treenail.read_skill(ran[0] / "peg.skill")


def test_loading_is_light() -> None:
    heavy = "{'sapien', 'numba', 'zenoh', 'numpy', 'rich'}"
    code = f"import sys, treenail; sys.exit(str({heavy} & set(sys.modules) or '') or 0)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_everything_that_is_promised_is_there() -> None:
    for name in treenail.__all__:
        assert getattr(treenail, name).__doc__, name
    assert set(dir(treenail)) == set(treenail.__all__)
    with pytest.raises(AttributeError, match="no attribute 'lood'; it has "):
        treenail.lood  # noqa: B018


def test_settings_are_changed_in_every_way_alike() -> None:
    a = treenail.load("initial", {"learner.alpha": 0.25, "title": 'say "x"', "limits.move_limit": 30}, episodes=7)
    b = treenail.load("initial", ["learner.alpha=0.25", "title='say \"x\"'", "limits.move_limit=30", "episodes=7"])
    assert a == b and (a.limits.move_limit, a.episodes) == (30, 7)


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"seeds": []}, "seeds: expected one or more, each once"),
        ({"seeds": [1, 1]}, "seeds: expected one or more, each once"),
        ({"seeds": [-1]}, "seed: expected 0 to "),
        ({"episodes": 0}, "episodes: expected 1 "),
        ({"jobs": 0}, "jobs: expected 1 or more, got 0"),
        ({"swaps": ["nonsense"]}, "nonsense"),
    ],
)
def test_what_cannot_be_run_is_refused_before_anything_starts(settings: dict[str, object], complaint: str) -> None:
    with pytest.raises(treenail.TreenailError, match=complaint):
        treenail.run("initial", **settings)  # type: ignore[arg-type]
    with pytest.raises(treenail.TreenailError, match="start: expected text, a number, True or False, got None"):
        treenail.load("initial", {"start": None})
