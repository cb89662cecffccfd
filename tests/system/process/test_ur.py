"""``treenail up ur``: through an emulated UR controller, byte for byte, a run ends as the one in one process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from services.cell.hil import FULL_SCALES

pytest.importorskip("rtde_control", reason="pip install '.[robot_ur]'")

LONG = 6
"""Episodes of a run in which every process is killed in turn."""
SUITE = "suite-round"
"""From random starts, by the felt learner."""


@pytest.fixture
def up_ur(up: Callable[..., Any], tmp_path: Path) -> Callable[..., Any]:
    """Starts ``treenail up ur`` on free ports."""

    def start(*options: str, episodes: int = LONG) -> Any:
        return up(tmp_path / "A", episodes, *options, cell="ur")

    return start


def test_the_suite_s_task_is_learnt_as_in_one_process_whichever_process_is_killed(
    up_ur: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    endpoint_of: Callable[[Path], str],
    kill_after: Callable[..., None],
    tmp_path: Path,
) -> None:
    process = up_ur("--robot", "emulated", "--experiment", SUITE)
    endpoint = endpoint_of(tmp_path / "A")
    for victim in ("robot_ur", "robot_ur.emulator", "sim", "task", "agent"):
        kill_after(process, endpoint, victim, 8)
    assert process.end() == 0, process.err
    assert "the sensor is read in counts" in process.out
    assert process.out.count("was killed by SIGKILL; starting it again") == 5
    assert digests_in(tmp_path / "A") == reference(LONG, 1, *FULL_SCALES, "start.decimals=4", experiment=SUITE)


def test_listed_moves_and_windows_of_the_wrist_s_samples_come_to_the_same(
    up_ur: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    listed_moves: tuple[str, ...],
    tmp_path: Path,
) -> None:
    """Packets are few a second here, so that a machine that has other things to do takes all of them in time."""
    sets = (*listed_moves, "sensor.window=3", "sensor.rate_hz=50", "noise.force_n=0.1")
    process = up_ur("--robot", "emulated", *(word for item in sets for word in ("--set", item)), episodes=2)
    assert process.end() == 0, process.err
    assert digests_in(tmp_path / "A") == reference(2, 1, *sets, *FULL_SCALES)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("sim", "--robot", "emulated"), "--arm, --box: expected with `treenail up ur` or `treenail up ros2` only"),
        (("ur", "--certs", "certs"), "--certs: expected none with emulated hardware"),
        (("ur", "--experiment", "suite-flange"), "moves.rotation_centre_mm: expected 0 with `treenail up ur"),
        (("ur", "--arm", "speed-mm-s=900"), "--speed-mm-s"),
        (("ur", "--box", "192.168.1.1"), "--box: expected with --robot ADDRESS only"),
        (("ur", "--robot", "two words"), "--robot: expected an address"),
    ],
)
def test_options_that_do_not_go_together_are_one_line(
    refused_up: Callable[..., str], words: tuple[str, ...], complaint: str
) -> None:
    assert complaint in refused_up(*words)
