"""The ten-line script of the README runs as it stands against a live cell, and the README shows it as it is."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "docs" / "examples" / "ask_q_table.py"


def test_the_script_reads_the_q_table_of_a_live_cell(
    run_module: Callable[..., object], small: Path, tmp_path: Path, wait_until: Callable[..., None]
) -> None:
    out = tmp_path / "run"
    words = ["--experiment", str(small), "--episodes", "100000", "--port", "0", "--no-viewer", "--out", str(out)]
    run_module("treenail.__main__", "up", "sim", *words)
    log = out / "logs" / "router.log"
    wait_until("the router listens", lambda: log.exists() and "listening" in log.read_text())
    endpoint = log.read_text().split("listening on ")[1].split()[0]

    def lines() -> list[str]:
        command = [sys.executable, str(SCRIPT), endpoint]
        return subprocess.run(command, capture_output=True, text=True, timeout=60).stdout.splitlines()

    wait_until("the agent has learnt something", lambda: len(lines()) > 1)
    found = lines()
    assert [line.split(":")[0] for line in found] == [f"state {number}" for number in range(len(found))]


def test_the_readme_shows_the_script() -> None:
    body = SCRIPT.read_text().partition("import json")[2]
    assert body in (ROOT / "README.md").read_text()
