"""A whole cell with swaps planned from its beginning ends as the run without a bus, and says what was swapped."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

SWAPS = ("--swap", "6:agent:learner=sarsa", "--swap", "10:classifier:rho=0.97")


def test_a_plan_gives_the_same_with_and_without_a_bus(
    up: Callable[..., Any],
    run_module: Callable[..., Any],
    digests_in: Callable[[Path], dict[str, str]],
    small: Path,
    tmp_path: Path,
) -> None:
    process = up(tmp_path / "cell", 16, *SWAPS)
    words = ("run", str(small), "--episodes", "16", "--seed-list", "1", *SWAPS, "--out", str(tmp_path / "alone"))
    alone = run_module("treenail.commands.experiment", *words)
    assert (process.end(), alone.end()) == (0, 0), process.err + alone.err
    assert process.err == ""
    assert "classifier and agent START FRESH" in process.out
    assert digests_in(tmp_path / "cell") == digests_in(tmp_path / "alone")
    told = [json.loads((tmp_path / name / "summary.json").read_text())["swaps"] for name in ("cell", "alone")]
    assert told[0] == told[1] and [text.split(":")[0] for text in told[0]] == ["from episode 6", "from episode 10"]
    store = ("--store", str(tmp_path / "cell" / "store.sqlite"), "--summary", str(tmp_path / "alone" / "summary.json"))
    replay = run_module("treenail.__main__", "replay", *store)
    assert replay.end() == 0, replay.out + replay.err
    again = up(tmp_path / "cell", 16, *SWAPS, "--swap", "12:agent:policy=greedy")
    assert again.end() != 0
    log = (tmp_path / "cell" / "logs" / "task.log").read_text()
    assert "expected a run in which episode 12 has not begun" in log
