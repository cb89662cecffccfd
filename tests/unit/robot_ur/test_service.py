"""The UR service's shell on a bus in memory: what it tells others, and what a stop means for any arm."""

from __future__ import annotations

from typing import cast

import pytest

from services.bus.testing import FakeService
from services.robot_ur.errors import LostError, StateError
from services.robot_ur.link import Cause, Link
from services.robot_ur.motion import Arm
from services.robot_ur.poses import from_ur
from services.robot_ur.service import UrShell
from services.robot_ur.settings import Settings
from services.robot_ur.states import PLAYING, State
from services.rules.guard import Guard
from services.wire.definition import Definition
from services.wire.keys import HOME
from services.wire.messages import FtPacket, Home, Moved, Refusal

STATE = State(5.0, from_ur((0.0,) * 6), 0.0, (0.0,) * 6, (0.0,) * 6, 7, 1, PLAYING, 0.0, (0.0,) * 3)


class StandingLink:
    """A driver whose arm stands; it counts how often its program may be sent."""

    ready = busy = False
    trouble = ""

    def __init__(self) -> None:
        self.allowed = 0

    def allow(self) -> None:
        """See Link."""
        self.allowed += 1


@pytest.fixture(params=[False, True], ids=["an arm", "an emulated arm"])
def emulated(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


@pytest.fixture
def made(emulated: bool) -> tuple[FakeService, UrShell, StandingLink]:
    service, link = FakeService("robot_ur"), StandingLink()
    settings = Settings("192.168.0.10", by_itself=emulated)
    return service, UrShell(service, cast("Link", link), Arm(settings), settings), link


def test_a_lost_controller_is_a_sample_that_nothing_is_learnt_from(
    made: tuple[FakeService, UrShell, StandingLink],
) -> None:
    service, shell, _ = made
    shell.on_state(STATE)
    shell.on_lost(LostError("no packets"), Cause.LINE)
    good, lost = service.published(FtPacket)
    guard = Guard(Definition(name="any"))
    assert guard.sensing(good, 0.0) is None
    assert "lost" in str(guard.sensing(lost, 0.0))


def test_what_a_person_or_a_safety_device_stopped_is_held_for_any_arm(
    made: tuple[FakeService, UrShell, StandingLink],
) -> None:
    _, shell, link = made
    shell.on_lost(StateError("protective stop"), Cause.SAFETY)
    assert shell.hold.held
    assert "protective stop" in shell.hold.stop.why
    assert link.allowed == 0


def test_a_held_arm_that_could_not_move_anyway_says_why(made: tuple[FakeService, UrShell, StandingLink]) -> None:
    service, shell, link = made
    shell.on_lost(StateError("protective stop"), Cause.SAFETY)
    link.trouble = "robot: expected a controller at 192.168.0.10, nobody answers there"
    service.answer_later(HOME, shell.on_home)
    home = Home(run="r", episode=0, x_mm=0.0, y_mm=0.0, z_mm=-1.0, rx_deg=0.0, ry_deg=0.0, rz_deg=0.0)
    answer = service.answer_to(Moved, HOME, home)
    assert isinstance(answer, Refusal)
    assert answer.reason == "stopped"
    assert answer.message == f"{link.trouble}; and then `treenail resume`"


def test_another_loss_holds_a_real_arm_only(made: tuple[FakeService, UrShell, StandingLink], emulated: bool) -> None:
    _, shell, link = made
    shell.on_lost(StateError("the program has ended"), Cause.PROGRAM)
    assert shell.hold.held is not emulated
    assert link.allowed == int(emulated)
