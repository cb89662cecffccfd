"""A cell whose learner proposes moves: killed, and through an old arm's line, it ends as the run in one process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from services.cell.hil import FULL_SCALES

EPISODES = 16
PROPOSED = (
    "moves.continuous={x_mm=0.2, y_mm=0.2, z_mm=0.2, rx_deg=0.2, ry_deg=0.2, rz_deg=0.1}",
    "learner={kind='plugin', name='srv'}",
    "limits.move_limit=80",
    "classifier.rho=0.9995",
)
SETS = tuple(word for item in PROPOSED for word in ("--set", item))


def test_each_worker_may_be_killed(
    up: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    endpoint_of: Callable[[Path], str],
    kill_after: Callable[..., None],
    tmp_path: Path,
) -> None:
    process = up(tmp_path / "A", EPISODES, *SETS)
    endpoint = endpoint_of(tmp_path / "A")
    for victim in ("agent", "classifier", "task", "sim"):
        kill_after(process, endpoint, victim, 30)
    assert process.end() == 0, process.err
    assert process.out.count("was killed by SIGKILL; starting it again") == 4
    assert digests_in(tmp_path / "A") == reference(EPISODES, 1, *PROPOSED)


def test_they_go_through_the_line_as_they_are(
    up: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    tmp_path: Path,
) -> None:
    process = up(tmp_path / "A", 8, *SETS, cell="hil")
    assert process.end() == 0, process.err
    assert digests_in(tmp_path / "A") == reference(8, 1, *PROPOSED, *FULL_SCALES)
