"""The complete examples of docs/python.md are the files beside it, and do what they say."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import treenail

DOCS = Path(__file__).resolve().parents[2] / "docs"
EXAMPLES = DOCS / "examples"
SHOWN = ("train_sb3.py", "read_run.py", "own_learner/two_best.py", "own_learner/pyproject.toml")
OWN = {"learner.kind": "plugin", "learner.name": "two-best", "learner.settings.alpha": 0.2}


def ran(folder: Path, script: Path, *words: str, path: Path | None = None) -> str:
    """Run a script in a folder and return what it printed."""
    # One thread each: more of them are slower here than what they compute.
    environment = {**os.environ, "OMP_NUM_THREADS": "1", **({} if path is None else {"PYTHONPATH": str(path)})}
    command = [sys.executable, str(script), *words]
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=170, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


@pytest.mark.parametrize("name", SHOWN)
def test_the_page_shows_the_files(name: str) -> None:
    assert (EXAMPLES / name).read_text() in (DOCS / "python.md").read_text()


def test_an_agent_of_stable_baselines3_is_trained(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")
    said = ran(tmp_path, EXAMPLES / "train_sb3.py", "256", "1")
    assert re.fullmatch(r"after 256 steps [01] of 1 inserted, mean force \d+\.\d\d N\n", said)


def test_a_learner_of_ones_own_learns(tmp_path: Path) -> None:
    """Installed as pip would, but for copying: a module, and the entry point that names it."""
    (tmp_path / "two_best.py").write_text((EXAMPLES / "own_learner" / "two_best.py").read_text())
    about = tmp_path / "two_best-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: two-best\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[treenail.learners]\ntwo-best = two_best:TwoBest\n")
    script = tmp_path / "script.py"
    script.write_text(
        "import treenail\n"
        f"done = treenail.run(treenail.load('initial', {OWN!r}, episodes=3), seeds=[1])\n"
        "print(done.runs[0].skill.definition.learner.name, len(done.runs[0].episodes))\n"
    )
    assert ran(tmp_path, script, path=tmp_path) == "two-best 3\n"


def test_a_run_is_read_into_pandas(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    results = treenail.run(treenail.load("initial", episodes=12), seeds=1)
    results.write(tmp_path / "run")
    table = pandas.read_csv(tmp_path / "run" / "episodes.csv")
    assert table.to_dict("records") == results.table(), "read as it is, without a word on how"
    said = ran(tmp_path, EXAMPLES / "read_run.py", "run")
    assert "mean_force_n" in said and len(said.splitlines()) == 4


def test_the_notebook_was_run_and_still_runs(tmp_path: Path) -> None:
    pytest.importorskip("gymnasium", reason="the extra gym is not installed")
    pytest.importorskip("matplotlib", reason="the extra cli is not installed")
    cells = json.loads((EXAMPLES / "environment.ipynb").read_text())["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell["outputs"]]
    assert {output["output_type"] for output in outputs} == {"stream", "display_data"}, "no errors"
    told = "".join("".join(output["text"]) for output in outputs if output["output_type"] == "stream")
    script = tmp_path / "script.py"
    script.write_text(
        "import matplotlib\n\nmatplotlib.use('agg')\n" + "\n".join("".join(cell["source"]) for cell in code)
    )
    assert ran(tmp_path, script) == told
