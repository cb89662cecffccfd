"""The emulated controller, judged by a client that is not ours: ur_rtde connects, moves, stops and recovers."""

from __future__ import annotations

import itertools
import struct
import time
from typing import Any

import pytest

from services.bus.emulated_arm import IdealArm
from services.robot_ur.emulator.controller import Behaviour, Controller
from services.robot_ur.emulator.dashboard import reply
from services.robot_ur.emulator.rtde import RtdeError, Session
from tests.unit.robot_ur.conftest import START, Rig, until

control = pytest.importorskip("rtde_control", reason="pip install '.[robot_ur]'")
receive = pytest.importorskip("rtde_receive")
dashboard = pytest.importorskip("dashboard_client")


def driver_of(rig: Rig) -> Any:
    return control.RTDEControlInterface(rig.address)


def board_of(rig: Rig) -> Any:
    board = dashboard.DashboardClient(rig.address)
    board.connect()
    return board


def test_ur_rtde_moves_the_arm_to_the_very_pose(rig: Rig) -> None:
    driver, eyes = driver_of(rig), receive.RTDEReceiveInterface(rig.address)
    pose = eyes.getActualTCPPose()
    for _ in range(5):
        pose[0] += 0.0002
        assert driver.moveL(pose, 0.05, 0.2)
        until(lambda: eyes.getActualTCPPose() == pose)
    pose[2] += 0.0002
    assert driver.moveL(pose, 0.05, 0.2, True)
    until(lambda: driver.getAsyncOperationProgress() < 0)
    until(lambda: eyes.getActualTCPPose() == pose)
    driver.disconnect()


def test_a_motion_under_way_is_stopped_on_its_way(rig: Rig) -> None:
    rig.press("motion 30000")
    driver, before_mm = driver_of(rig), rig.shown[3]
    goal = [before_mm / 1000 + 0.1, *START[1:]]
    assert driver.moveL(goal, 0.05, 0.2, True)
    until(lambda: driver.getAsyncOperationProgress() >= 0)
    driver.stopL(2.0)
    until(lambda: driver.getAsyncOperationProgress() < 0)
    assert rig.shown[3] == pytest.approx(before_mm + 50.0)
    driver.disconnect()


def test_a_protective_stop_in_mid_motion_is_recovered(rig: Rig) -> None:
    rig.press("protect_in_motion")
    driver, eyes, board = driver_of(rig), receive.RTDEReceiveInterface(rig.address), board_of(rig)
    before_mm = rig.shown[3]
    goal = [before_mm / 1000 + 0.01, *START[1:]]
    assert not driver.moveL(goal, 0.05, 0.2)
    until(eyes.isProtectiveStopped)
    assert board.safetystatus() == "Safetystatus: PROTECTIVE_STOP"
    assert rig.shown[3] == pytest.approx(before_mm + 5.0), "half-way"
    assert not driver.moveL(goal, 0.05, 0.2), "nothing moves before it is unlocked"
    board.unlockProtectiveStop()
    assert driver.reuploadScript()
    until(driver.isProgramRunning)
    time.sleep(0.1)
    assert driver.moveL(goal, 0.05, 0.2)
    assert rig.shown[3] == pytest.approx(before_mm + 10.0)
    driver.disconnect()


def test_a_protective_stop_is_not_unlocked_at_once(rig: Rig) -> None:
    rig.press("unlock_after 5")
    rig.press("protect")
    with pytest.raises(RuntimeError, match="until 5s after"):
        board_of(rig).unlockProtectiveStop()


def test_power_and_brakes_are_two_steps_and_an_emergency_stop_takes_both(rig: Rig) -> None:
    board = board_of(rig)
    rig.press("estop 1")
    assert board.robotmode() == "Robotmode: POWER_OFF"
    board.brakeRelease()
    assert board.robotmode() == "Robotmode: POWER_OFF", "not while the button is pressed"
    rig.press("estop 0")
    board.brakeRelease()
    assert board.robotmode() == "Robotmode: POWER_OFF", "one step at a time"
    board.powerOn()
    assert board.robotmode() == "Robotmode: IDLE"
    board.brakeRelease()
    assert board.robotmode() == "Robotmode: RUNNING"


def test_the_registers_are_one_client_s(rig: Rig) -> None:
    driver = driver_of(rig)
    with pytest.raises(RuntimeError, match="already in use"):
        driver_of(rig)
    driver.disconnect()


def test_local_mode_and_unknown_outputs_are_refused(rig: Rig) -> None:
    rig.press("remote 0")
    with pytest.raises(RuntimeError, match="remote control"):
        driver_of(rig)
    rig.press("forget ft_raw_wrench")
    with pytest.raises(RuntimeError, match="ft_raw_wrench"):
        receive.RTDEReceiveInterface(rig.address, 125.0, ["timestamp", "ft_raw_wrench"])


def test_the_watchdog_ends_the_program_of_a_client_that_is_gone(rig: Rig) -> None:
    driver = driver_of(rig)
    assert driver.setWatchdog(10.0)
    until(lambda: rig.shown[2] == 1, "the program has ended")
    driver.disconnect()


# -- by the byte ------------------------------------------------------------------------------------------------------


def controller() -> Controller:
    return Controller(IdealArm(START), Behaviour())


def packet(kind: str, body: bytes) -> bytes:
    return (len(body) + 3).to_bytes(2, "big") + kind.encode() + body


RATE = bytes.fromhex("405f400000000000")
"""125.0 as a float64, big-endian."""


@pytest.mark.parametrize(
    ("asked", "answered"),
    [
        # Sizes are of the whole packet, numbers big-endian (RTDE guide).
        (bytes.fromhex("0005560002"), bytes.fromhex("00045601")),
        (bytes.fromhex("0005560001"), bytes.fromhex("00045600")),
        (bytes.fromhex("000376"), bytes.fromhex("0013760000000500000015" + "00" * 8)),
        (packet("O", RATE + b"timestamp"), packet("O", b"\x01DOUBLE")),
        (packet("O", RATE + b"timestamp,"), packet("O", b"\x01DOUBLE")),
        (packet("O", RATE + b"nosuch,robot_mode"), packet("O", b"\x00NOT_FOUND,INT32")),
        (packet("I", b"input_int_register_18,speed_slider_mask"), packet("I", b"\x01INT32,UINT32")),
        (packet("I", b"output_int_register_0"), packet("I", b"\x00NOT_FOUND")),
        (bytes.fromhex("000353"), bytes.fromhex("00045301")),
        (bytes.fromhex("000350"), bytes.fromhex("00045001")),
    ],
)
def test_packets_whole_and_byte_by_byte(asked: bytes, answered: bytes) -> None:
    whole, slow = Session(controller()), Session(controller())
    assert whole.receive(asked) == answered
    assert b"".join(slow.receive(asked[place : place + 1]) for place in range(len(asked))) == answered


def test_outputs_are_packed_in_the_order_asked_for() -> None:
    made = controller()
    session = Session(made)
    session.receive(packet("O", RATE + b"robot_mode,safety_status_bits,payload") + packet("S", b""))
    made.protect()
    made.payload_kg = 1.5
    body = bytes.fromhex("01" + "00000007" + "00000004" + "3ff8000000000000")
    assert session.due(1.0) == 1.0
    assert session.outputs(1.0) == packet("U", body)


def test_each_packet_has_the_next_sample_of_the_wrist_with_the_time_that_it_is_due_at() -> None:
    made = controller()
    made.loads = tuple((float(number), 0.0, 0.0, 0.0, 0.0, 0.0) for number in range(3))
    one, other = Session(made), Session(made)
    for session in (one, other):
        session.receive(packet("O", RATE + b"timestamp,ft_raw_wrench") + packet("S", b""))
    shown = [struct.unpack(">2d", one.outputs(0.5 + 0.008 * number)[4:20]) for number in range(5)]
    assert shown == [(0.5 + 0.008 * number, float(number % 3)) for number in range(5)]
    assert struct.unpack(">2d", other.outputs(0.5)[4:20]) == (0.5, 0.0)


def test_a_late_packet_comes_with_the_time_that_it_was_due_at_and_none_is_left_out() -> None:
    session = Session(controller())
    assert session.due(0.0) is None
    session.receive(packet("O", RATE + b"timestamp") + packet("S", b""))
    late = [1.0, 1.008, 1.058, *(1.06 + 0.002 * number for number in range(40)), 1.5]
    due = [(now_s, stamp_s) for now_s in late if (stamp_s := session.due(now_s)) is not None]
    stamps = [stamp_s for _, stamp_s in due[:-1]]
    assert stamps == pytest.approx([1.0 + 0.008 * number for number in range(len(stamps))])
    assert len(due) > 15
    gaps = [after[0] - before[0] for before, after in itertools.pairwise(due)]
    assert min(gaps) > 0.0039, "one that looks three times in 8 ms sees each"
    assert due[-1] == (1.5, 1.5), "of what is later than a quarter of a second some is lost"


def test_inputs_come_by_recipe_and_are_negative_too() -> None:
    made = controller()
    session = Session(made)
    session.receive(packet("I", b"input_int_register_0,input_double_register_0"))
    session.receive(packet("U", bytes.fromhex("01" + "ffffffff" + "bff8000000000000")))
    assert (made.number("input_int_register_0"), made.number("input_double_register_0")) == (-1.0, -1.5)


@pytest.mark.parametrize("nonsense", ["000156", "ffff56", "0004550a"])
def test_nonsense_ends_the_connection(nonsense: str) -> None:
    with pytest.raises(RtdeError):
        Session(controller()).receive(bytes.fromhex(nonsense))


def test_the_dashboard_understands_no_more_than_it_does() -> None:
    assert reply(controller(), "jump") == 'could not understand: "jump"'
    assert reply(Controller(IdealArm(START), Behaviour(remote=False)), "power off").startswith("Command is not allowed")
