"""A whole cell whose robot is reached over the supervisor line (DDCMP) ends byte-equal with one that has no line."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

SENSOR = ("sensor.full_scale_n=65", "sensor.full_scale_dnm=50")


def found(live: Any, process: Any, pattern: str) -> str:
    """Wait until a process has printed something; return the pattern's first group."""
    live.wait_until(pattern, lambda: re.search(pattern, process.out) or process.popen.poll() is not None)
    match = re.search(pattern, process.out)
    assert match is not None, process.out + process.err
    return match.group(1)


def test_a_cell_over_the_supervisor_line_ends_byte_equal(live: Any, reference: Callable[..., dict[str, str]]) -> None:
    connect = ("--connect", live.endpoint)
    sets = [word for item in SENSOR for word in ("--set", item)]
    live.start("task", "--experiment", str(live.definition), "--seed", "1", "--episodes", "2", *sets)
    live.start("classifier")
    live.start("agent")
    live.start("sim", "--cell", "a-world")
    scales = ("--calibration-s", "0.05", "--full-scales", "65,65,65,50,50,50")
    card = live.run_module("services.sensor_jr3.emulator", *connect, "--follow", "a-world", "--no-auto-zero", *scales)
    live.start("sensor_jr3", "--url", found(live, card, r"(tcp://\S+)"), "--settle-s", "0")
    world = ("--mode", "supervisory", "--world", "a-world", "--sensor-s", "5")
    robot = live.run_module("services.robot_link.emulator", *world, *connect)
    url = found(live, robot, r"listening on (socket://\S+)")
    patience = ("--settle-s", "0.002", "--oldest-s", "5", "--withdraw-mm", "20")
    live.start("robot_link", "--url", url, "--mode", "supervisory", "--auto-resume", *patience)
    assert live.digests() == reference(2, 1, *SENSOR)
