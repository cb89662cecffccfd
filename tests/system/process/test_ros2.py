"""``treenail up sim --ros2``: what ROS 2 sees delays and changes nothing. ``up ros2``: nor does an arm behind it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from services.cell.hil import FULL_SCALES
from services.cell.ros2 import START, RosArm
from services.wire.definition import Sensor

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")
pytest.importorskip("xxhash", reason="the extra ros2 is not installed")

EPISODES = 20
LONG = 6
"""Episodes of a run in which every process is killed in turn."""
THERE = ("--arm", "target=/arm/target", "--arm", "pose=/arm/pose", "--arm", "frame=base_link")
SUITE = "suite-round"
"""From random starts, by the felt learner."""


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


def test_an_arm_behind_topics_learns_the_same_whichever_process_is_killed(
    up: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    endpoint_of: Callable[[Path], str],
    kill_after: Callable[..., None],
    tmp_path: Path,
) -> None:
    process = up(tmp_path / "A", LONG, "--robot", "emulated", "--experiment", SUITE, cell="ros2")
    endpoint = endpoint_of(tmp_path / "A")
    for victim in ("ros2.robot", "ros2.emulator", "ros2.sensor", "sim", "task"):
        kill_after(process, endpoint, victim, 8)
    assert process.end(120.0) == 0, process.err
    assert process.out.count("was killed by SIGKILL; starting it again") == 5
    assert digests_in(tmp_path / "A") == reference(LONG, 1, *FULL_SCALES, "start.decimals=4", experiment=SUITE)


def test_an_arm_that_comes_later_and_is_not_ours_learns_the_same(
    up: Callable[..., Any],
    run_module: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    endpoint_of: Callable[[Path], str],
    tmp_path: Path,
) -> None:
    arm = RosArm().commands("a", "", Sensor())["ros2_robot"][4:]
    sensor = ("topic=/fts/wrench", "frame=tool", "rate-hz=125", "oldest-s=1")
    sets = (*FULL_SCALES, "start.decimals=4")
    words = [word for option in _as_given(arm) for word in ("--arm", option)]
    words += [word for option in sensor for word in ("--sensor", option)]
    words += [word for item in sets for word in ("--set", item)]
    process = up(tmp_path / "A", LONG, *words, "--experiment", SUITE, cell="ros2")
    here = ("--connect", endpoint_of(tmp_path / "A"))
    run_module("services.sim", "--cell", "world", *here)
    run_module("services.ros2.emulator", "--cell", "a", "--world", "world", "--start", START, *here)
    assert process.end(120.0) == 0, process.err
    assert "nothing moves before `treenail resume`" in process.out
    assert digests_in(tmp_path / "A") == reference(LONG, 1, *sets, experiment=SUITE)


def _as_given(options: Sequence[str]) -> list[str]:
    """Return options as `--arm` takes them, each one word: name=value, or a name alone."""
    words: list[str] = []
    for word in options:
        if word.startswith("--"):
            words.append(word.removeprefix("--"))
        else:
            words[-1] += f"={word}"
    return words


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("sim", "--ros", "tcp/127.0.0.1:7448"), "--ros, --distribution: expected with --ros2 only"),
        (
            ("ros2", "--robot", "192.168.0.10"),
            "whose arm is where its topics are, got '192.168.0.10'; say --arm target",
        ),
        (("ros2", *THERE), "--arm, --sensor, --box: expected none for the emulated arm; for one that is there --arm"),
        (
            ("ros2", *THERE, "--sensor", "topic=/wrench"),
            "ros2: --sensor: the following arguments are required: --frame",
        ),
        (("ros2", *THERE, "--arm", "domain=3", "--box", "192.168.1.1"), "--ros2 DOMAIN, --ros and --distribution say"),
        (("ur", "--sensor", "topic=/wrench"), "--sensor: expected with `treenail up ros2` only, got `treenail up ur`"),
        (("sim", "--ros2", "233"), "expected a whole number from 0 to 232, got '233'"),
        (("sim", "--ros2", "--distribution", "humble"), "expected one of jazzy, jazzy-0.2.3, kilted"),
        (("sim", "--ros2", "--certs", "certs"), "--ros2: expected --ros ENDPOINT, ROS's own router, with --certs"),
    ],
)
def test_options_that_do_not_go_together_are_one_line(
    refused_up: Callable[..., str], words: tuple[str, ...], complaint: str
) -> None:
    assert complaint in refused_up(*words)
