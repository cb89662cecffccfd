"""``treenail up sim --ros2``: what ROS 2 sees delays and changes nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")
pytest.importorskip("xxhash", reason="the extra ros2 is not installed")

EPISODES = 20


def test_a_run_that_ros_2_sees_ends_as_the_one_in_one_process(
    up: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    tmp_path: Path,
) -> None:
    process = up(tmp_path / "A", EPISODES, "--ros2")
    assert process.end() == 0, process.err
    assert digests_in(tmp_path / "A") == reference(EPISODES, 1)
    log = (tmp_path / "A" / "logs" / "ros2_out.log").read_text()
    assert "/treenail/a/wrench and more in domain 0" in log and "Traceback" not in log


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("sim", "--ros", "tcp/127.0.0.1:7448"), "--ros, --distribution: expected with --ros2 only"),
        (("sim", "--ros2", "233"), "expected a whole number from 0 to 232, got '233'"),
        (("sim", "--ros2", "--distribution", "humble"), "expected one of jazzy, jazzy-0.2.3, kilted"),
        (("sim", "--ros2", "--certs", "certs"), "--ros2: expected --ros ENDPOINT, ROS's own router, with --certs"),
    ],
)
def test_options_that_do_not_go_together_are_one_line(
    run_module: Callable[..., Any], words: tuple[str, ...], complaint: str
) -> None:
    process = run_module("treenail.__main__", "up", *words)
    assert process.end() == 2
    assert complaint in process.err
    assert process.err.count("\n") == 1
