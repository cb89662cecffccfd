"""Home and moves through dialogue and emulated controller, joined in memory: arrival, refusals, faults."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.robot_link.emulator import poses
from services.robot_link.emulator.arm import IdealArm
from services.robot_link.emulator.controller import Behaviour, Controller
from services.robot_link.emulator.in_memory import Joined
from services.robot_link.errors import ArrivalError, ControllerError, LinkError, UnsettledError
from services.robot_link.settings import ArmSettings, Prompt, SettingError
from services.robot_link.val2.dialects import DIALECTS
from services.robot_link.val2.motion import Arm, Command
from services.robot_link.val2.terminal import Terminal
from services.wire.actions import Increment
from services.wire.messages import Home

START = poses.frame((420.0, 150.0, 80.0, 30.0, 170.0, -20.0), "zyz")
HOME = Home(run="r", episode=3, x_mm=1.6, y_mm=-2.2, z_mm=-1.0, rx_deg=1.8, ry_deg=0.4, rz_deg=0.0)
STEP = Increment(dx_mm=0.2)


def joined(behaviour: Behaviour | None = None) -> Joined:
    controller = Controller(IdealArm(START.copy()), behaviour or Behaviour(), {"TREENAIL": START.copy()})
    made = Joined(controller, Terminal(DIALECTS["val2"]))
    made.greet()
    return made


def ready(made: Joined, settings_: ArmSettings | None = None) -> Arm:
    arm = Arm(settings_ or ArmSettings())
    made.run(arm.get_ready())
    return arm


@pytest.mark.parametrize("convention", poses.CONVENTIONS)
@pytest.mark.parametrize("prompt", ["started", "arrived"])
@pytest.mark.parametrize("motion_s", [0.0, 0.15])
def test_home_and_moves_lead_where_they_should(convention: str, prompt: Prompt, motion_s: float) -> None:
    made = joined(Behaviour(convention=convention, prompt=prompt, motion_s=motion_s))
    arm = ready(made, ArmSettings(prompt=prompt))
    assert arm.convention == convention
    assert made.controller.motions == 0, "getting ready moves nothing"
    made.run(arm.home(HOME))
    # The pose of the tip in the hole's frame, whose mouth is 20 mm below TREENAIL.
    hole = START @ poses.frame((0.0, 0.0, 20.0, 0.0, 0.0, 0.0), "zyz")
    tip = np.linalg.inv(hole) @ made.controller.arm.place
    assert poses.increment_of(tip) == pytest.approx((1.6, -2.2, -1.0, 1.8, 0.4, 0.0), abs=1e-4)
    before = made.controller.arm.place.copy()
    for increment in (STEP, Increment(rx_deg=-0.2), Increment(dz_mm=0.2), Increment(rz_deg=0.2)):
        assert made.run(arm.move(increment, 3, 1)) == increment
        made_step = np.linalg.inv(before) @ made.controller.arm.place
        assert poses.increment_of(made_step) == increment
        before = made.controller.arm.place.copy()


def test_episode_and_step_are_told_only_when_wished() -> None:
    for tell in (False, True):
        made = joined()
        arm = ready(made, ArmSettings(tell_episode=tell))
        made.run(arm.home(HOME))
        made.run(arm.move(STEP, 3, 1))
        told = [line for line in made.controller.heard if "EPISODE" in line or "STEP" in line]
        assert told == (["DO EPISODE = 3", "DO STEP = 0", "DO EPISODE = 3", "DO STEP = 1"] if tell else [])


def test_nothing_moves_before_the_convention_is_settled() -> None:
    made = joined(Behaviour(convention="val_offset"))
    arm = Arm(ArmSettings(convention="zyz"))
    with pytest.raises(UnsettledError, match="expected the convention zyz that was set, got val_offset"):
        made.run(arm.get_ready())
    with pytest.raises(UnsettledError):
        made.run(arm.home(HOME))
    assert made.controller.motions == 0


def test_a_confirmed_convention_needs_no_probe() -> None:
    made = joined()
    arm = ready(made, ArmSettings(convention="zyz", confirmed=True))
    assert arm.convention == "zyz"
    assert not any("SET" in line for line in made.controller.heard)
    with pytest.raises(SettingError, match="--convention"):
        ArmSettings(confirmed=True)


def test_only_home_is_taken_before_home_and_after_a_fault() -> None:
    made = joined()
    arm = ready(made)
    with pytest.raises(LinkError, match="only home"):
        made.run(arm.move(STEP, 0, 1))
    made.run(arm.home(HOME))
    made.controller.faults.half_way = 1
    with pytest.raises(ArrivalError, match=r"got 0.1\d* mm"):
        made.run(arm.move(STEP, 0, 1))
    motions = made.controller.motions
    with pytest.raises(LinkError, match="only home"):
        made.run(arm.move(STEP, 0, 1))
    assert made.controller.motions == motions


@pytest.mark.parametrize(
    ("fault", "value", "error", "words"),
    [
        ("power", False, ControllerError, "Arm power off"),
        ("nonsense", 1, LinkError, "expected a line with X Y Z O A T"),
        ("misheard", 1, LinkError, "expected the echo"),
        ("garbage", 1, LinkError, "got byte 93"),
        ("silence", True, LinkError, "in time"),
    ],
)
def test_each_fault_is_told_and_nobody_thinks_that_it_moved(
    fault: str, value: int, error: type[LinkError], words: str
) -> None:
    made = joined()
    arm = ready(made)
    made.run(arm.home(HOME))
    before = made.controller.motions
    setattr(made.controller.faults, fault, value)
    with pytest.raises(error, match=words):
        made.run(arm.move(STEP, 0, 1))
    if fault in ("power", "misheard", "silence"):
        assert made.controller.motions == before
    if fault == "misheard":
        assert made.controller.heard[-1] == "ABORT"


def test_a_location_that_is_not_taught_is_said() -> None:
    made = joined()
    del made.controller.locations["TREENAIL"]
    arm = ready(made)
    with pytest.raises(ControllerError, match="Undefined value: TREENAIL"):
        made.run(arm.home(HOME))


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_noise_on_the_way_back_never_makes_a_move_that_was_not_meant(data: st.DataObject) -> None:
    made = joined()
    arm = ready(made)
    made.run(arm.home(HOME))
    place = made.controller.arm.place.copy()

    def noise(shown: bytes) -> bytes:
        if not shown:
            return shown
        at, value = data.draw(st.integers(0, len(shown) - 1)), data.draw(st.integers(0, 255))
        return shown[:at] + bytes([value]) + shown[at + 1 :]

    made._noise = noise
    with contextlib.suppress(LinkError):
        made.run(arm.move(STEP, 0, 1))
    step = poses.increment_of(np.linalg.inv(place) @ made.controller.arm.place)
    assert step in (STEP, Increment()), "the one that was asked for, or none"


@settings(max_examples=200, deadline=None)
@given(st.lists(st.one_of(st.binary(max_size=30), st.sampled_from([b"DO MOVE ", b"HERE:", b"TRANS(", b"1,", b")\r"]))))
def test_no_bytes_crash_the_emulated_controller(pieces: list[bytes]) -> None:
    controller = Controller(IdealArm(START.copy()), Behaviour(), {"A": START})
    for number, piece in enumerate(pieces):
        controller.receive(piece, float(number))
        controller.tick(float(number))
    assert np.isfinite(controller.arm.place).all()


def test_align_puts_the_tool_along_an_axis() -> None:
    made = joined()
    made._do(Command("DO ALIGN"))
    made._do(Command("WHERE"))
    place = made.controller.arm.place
    assert place[:3, 2] == pytest.approx((0.0, 0.0, -1.0))
    assert np.allclose(place[:3, :3] @ place[:3, :3].T, np.eye(3))
