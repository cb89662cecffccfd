"""What ``treenail up`` says of a cell that waits."""

from __future__ import annotations

from typing import cast

import pytest
import zenoh

from services.bus.fake_bus import FakeSample
from services.cell.client import Client
from services.wire.codec import encode, encoding_of
from services.wire.messages import Alive
from tests.unit.heartbeats import alive
from treenail.commands.progress import because
from treenail.commands.up import others

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


class Half(Client):
    """A client of a cell in which one service answers and another is too busy with starting."""

    def __init__(self, encoding: str) -> None:
        payload = zenoh.ZBytes(encode(alive("ros2_robot", phase=ROUTER)))
        key = zenoh.KeyExpr("treenail/a/alive/ros2_robot")
        self._sample = FakeSample(key, payload, zenoh.Encoding(encoding), None)

    def replies(self, name: str, timeout_s: float) -> tuple[list[zenoh.Sample], list[str]]:
        return [cast("zenoh.Sample", self._sample)], [f"expected an answer within {timeout_s:g} s, got none"]


def test_a_service_too_busy_to_answer_neither_ends_the_cell_nor_hides_what_the_others_say() -> None:
    (other,) = others(Half(encoding_of(Alive)))
    assert (other.service, other.phase) == ("ros2_robot", ROUTER)
    assert others(Half("application/octet-stream")) == []
