"""What ``treenail up`` says of a cell that waits."""

from __future__ import annotations

import pytest

from services.wire.messages import Alive
from treenail.commands.progress import because

ROUTER = "waiting for ROS's router at tcp/127.0.0.1:7448"


def alive(service: str, phase: str) -> Alive:
    """Return what a service says of itself."""
    return Alive(
        service=service,
        instance="1",
        host="here",
        pid=1,
        version="0.1.0",
        contract_sha256="0" * 64,
        started_t_ns=1,
        beat=1,
        handled=0,
        refused={},
        run=None,
        phase=phase,
    )


def test_who_holds_the_task_up_says_why_in_the_same_line() -> None:
    others = [alive("ros2_robot", ROUTER), alive("agent", "running"), alive("store", "running, 3.1 MB")]
    phase = "waiting for robot (no answer to a motion)"
    assert because(phase, [*others, alive("task", phase)]) == f"{phase}; ros2_robot: {ROUTER}"


@pytest.mark.parametrize("phase", ["running", "finished", "stopped: robot: protective stop"])
def test_a_task_that_does_not_wait_is_held_up_by_nobody(phase: str) -> None:
    assert because(phase, [alive("ros2_robot", ROUTER)]) == phase


def test_who_waits_for_the_task_is_not_the_reason() -> None:
    others = [alive("agent", "waiting for task (no experiment)"), alive("robot_link", "making home")]
    assert because("waiting for store", others) == "waiting for store"
