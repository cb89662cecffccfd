"""``treenail up hil``: through emulated controller and sensor, byte for byte, a run ends as the one in one process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from services.cell.hil import FULL_SCALES

EPISODES = 12
LONG = 24
"""Episodes of a run in which every process is killed in turn."""


@pytest.fixture
def up_hil(up: Callable[..., Any], tmp_path: Path) -> Callable[..., Any]:
    """Starts ``treenail up hil`` on free ports."""

    def start(*options: str, episodes: int = EPISODES) -> Any:
        return up(tmp_path / "A", episodes, *options, cell="hil")

    return start


def test_listed_moves_go_through_the_line_as_they_are(
    up_hil: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    listed_moves: tuple[str, ...],
    tmp_path: Path,
) -> None:
    process = up_hil(*(word for item in listed_moves for word in ("--set", item)), episodes=4)
    assert process.end() == 0, process.err
    assert digests_in(tmp_path / "A") == reference(4, 1, *listed_moves, *FULL_SCALES)


@pytest.mark.parametrize("link", ["terminal", "supervisory"])
def test_through_both_protocols_a_run_ends_as_the_one_in_one_process(
    up_hil: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    tmp_path: Path,
    link: str,
) -> None:
    process = up_hil("--link", link)
    assert process.end() == 0, process.err
    assert process.err == ""
    assert "the sensor is read in counts" in process.out
    assert digests_in(tmp_path / "A") == reference(EPISODES, 1, *FULL_SCALES)


def test_any_process_of_it_may_be_killed(
    up_hil: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    endpoint_of: Callable[[Path], str],
    kill_after: Callable[..., None],
    tmp_path: Path,
) -> None:
    process = up_hil(episodes=LONG)
    endpoint = endpoint_of(tmp_path / "A")
    for victim in ("robot_link", "sensor_jr3", "robot_link.emulator", "sensor_jr3.emulator", "sim", "task", "agent"):
        kill_after(process, endpoint, victim, 8)
    assert process.end() == 0, process.err
    assert process.out.count("was killed by SIGKILL; starting it again") == 7
    assert digests_in(tmp_path / "A") == reference(LONG, 1, *FULL_SCALES)


def test_windows_and_tares_of_single_samples_come_to_the_same_from_random_starts(
    up_hil: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    endpoint_of: Callable[[Path], str],
    kill_after: Callable[..., None],
    tmp_path: Path,
) -> None:
    """The noisy sensor with a heavy tool: the emulated card plays the samples, each mean is made of what was read."""
    process = up_hil("--experiment", "suite-heavy-tool", episodes=2)
    endpoint = endpoint_of(tmp_path / "A")
    for victim in ("robot_link", "task"):  # one of the sensor's would need `treenail resume`: its zero is lost
        kill_after(process, endpoint, victim, 8)
    assert process.end() == 0, process.err
    sets = (*FULL_SCALES, "start.decimals=4")
    assert digests_in(tmp_path / "A") == reference(2, 1, *sets, experiment="suite-heavy-tool")


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("sim", "--thesis-speed"), "--link, --thesis-speed: expected with `treenail up hil` only"),
        (("sim", "--link", "terminal"), "--link, --thesis-speed: expected with `treenail up hil` only"),
        (("hil", "--certs", "certs"), "--certs: expected none with emulated hardware"),
        (("hil", "--experiment", "suite-flange"), "moves.rotation_centre_mm: expected 0 with `treenail up hil`"),
    ],
)
def test_options_that_do_not_go_together_are_one_line(
    refused_up: Callable[..., str], words: tuple[str, ...], complaint: str
) -> None:
    assert complaint in refused_up(*words)
