"""What ``treenail up`` says of a cell that waits."""

from __future__ import annotations

import pytest

from tests.unit.heartbeats import alive
from treenail.commands.progress import because

ROUTER = "waiting for ROS's router at tcp/127.0.0.1:7448"


def test_who_holds_the_task_up_says_why_in_the_same_line() -> None:
    others = [
        alive("ros2_robot", phase=ROUTER),
        alive("agent", phase="running"),
        alive("store", phase="running, 3.1 MB"),
    ]
    phase = "waiting for robot (no answer to a motion)"
    assert because(phase, [*others, alive("task", phase=phase)]) == f"{phase}; ros2_robot: {ROUTER}"


@pytest.mark.parametrize("phase", ["running", "finished", "stopped: robot: protective stop"])
def test_a_task_that_does_not_wait_is_held_up_by_nobody(phase: str) -> None:
    assert because(phase, [alive("ros2_robot", phase=ROUTER)]) == phase


def test_who_waits_for_the_task_is_not_the_reason() -> None:
    others = [alive("agent", phase="waiting for task (no experiment)"), alive("robot_link", phase="making home")]
    assert because("waiting for store", others) == "waiting for store"
