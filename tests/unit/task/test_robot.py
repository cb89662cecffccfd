"""The robot as the task sees it: what a sensor shows that began anew does not count for the motion before."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from services.bus.fake_bus import FakeQuery
from services.bus.testing import FakeService
from services.rules.window import one_sample
from services.task.robot import Robot
from services.wire.definition import Sensor
from services.wire.keys import FT, HOME, MOVE
from services.wire.messages import FtPacket, Home, Message, Move, Moved, Refusal

SENSOR = "51"
RUN = "0123456789abcdef-s1"
PERIOD_NS = 2_000_000
HOMING = Home(run=RUN, episode=0, x_mm=0.0, y_mm=0.0, z_mm=-1.0, rx_deg=0.0, ry_deg=0.0, rz_deg=0.0)
MOVE_1 = Move(run=RUN, episode=0, step=1, dz_mm=0.2)


class Bench:
    """A task's robot whose every motion is made at once."""

    def __init__(self) -> None:
        self.service = FakeService("task")
        self.service.hold("ros2_sensor", SENSOR)
        self.robot = Robot(self.service, Sensor(), lambda _: None)
        self.asked = 0
        self.service.bus.answers |= {MOVE: self._move}

    def feel(self, number: int, force_n: float, status: int = 0) -> None:
        """Let a sample of the stream come."""
        load = ((0.0, 0.0, -force_n), (0.0, 0.0, 0.0))
        packet = one_sample(number, number * PERIOD_NS, PERIOD_NS, status, load)
        self.service.hear(FT, packet, SENSOR)

    def _move(self, query: FakeQuery) -> Message | None:
        query.message(Move)
        self.asked += 1
        return Moved(run=RUN, episode=0, step=1, dz_mm=0.2, arrived_t_ns=10 * PERIOD_NS)


def made(bench: Bench) -> tuple[int, float]:
    """Return how often the motion was asked for, and the force that was felt after it."""
    done: list[FtPacket] = []

    def go(_: object) -> None:
        answer = bench.robot.go(MOVE_1)
        assert answer is not None
        done.append(answer[1])

    bench.service.run_for(go, 5.0)
    (felt,) = done
    return bench.asked, -felt.force_n[0][2]


def test_a_sample_after_the_arrival_is_what_is_felt() -> None:
    bench = Bench()
    bench.service.later(0.1, lambda: bench.feel(12, 1.0))
    assert made(bench) == (1, 1.0)


@pytest.mark.parametrize("status", [4, 8, 16])
def test_after_a_sensor_began_anew_the_motion_is_asked_for_again(status: int) -> None:
    bench = Bench()
    bench.service.later(0.1, lambda: bench.feel(11, 1.0, status))
    bench.service.later(0.1, lambda: bench.feel(12, 0.0))
    bench.service.later(0.3, lambda: bench.feel(13, 2.0))
    assert made(bench) == (2, 2.0)


def test_a_robot_that_lost_its_place_is_led_back_no_faster_than_it_is_felt() -> None:
    """It may be a new process, whose guard takes a sensor for dead that shows the same over several motions."""
    bench, events = Bench(), list[str]()
    at: list[int | None] = [None]

    def felt(number: int) -> None:
        events.append("felt")
        bench.feel(number, 1.0)

    def made_at(step: int) -> Moved:
        at[0] = step
        events.append(f"asked {step}")
        number = 10 * len(events)
        bench.service.later(0.05, lambda: felt(number + 1))
        return Moved(run=RUN, episode=0, step=step, arrived_t_ns=number * PERIOD_NS)

    def home(query: FakeQuery) -> Message:
        query.message(Home)
        return made_at(0)

    def move(query: FakeQuery) -> Message:
        step = query.message(Move).step
        if at[0] != step - 1:
            return Refusal(reason="out_of_order", message="the robot is not homed")
        return made_at(step)

    def go(_: object) -> None:
        assert bench.robot.go(HOMING) is not None
        for step in (1, 2, 3):
            assert bench.robot.go(replace(MOVE_1, step=step)) is not None
        at[0] = None  # killed, and started again
        assert bench.robot.go(replace(MOVE_1, step=4)) is not None

    bench.service.bus.answers |= {HOME: home, MOVE: move}
    bench.service.run_for(go, 10.0)
    steps = [0, 1, 2, 3, 0, 1, 2, 3, 4]
    assert events == [event for step in steps for event in (f"asked {step}", "felt")]
