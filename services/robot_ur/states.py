"""What the controller shows of itself in one packet, and what of it keeps the arm from moving. Pure.

Numbers as in Universal Robots' "Real-Time Data Exchange (RTDE) Guide".
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from services.rules.poses import Pose


class RobotMode(Enum):
    """What the arm's drives do; the value is what people are told."""

    NO_CONTROLLER = -1
    DISCONNECTED = 0
    CONFIRM_SAFETY = 1
    BOOTING = 2
    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    BACKDRIVE = 6
    RUNNING = 7
    UPDATING = 8


class SafetyMode(Enum):
    """What the safety system does."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9
    VALIDATE_JOINT = 10
    UNDEFINED = 11
    AUTOMATIC_MODE_SAFEGUARD_STOP = 12
    THREE_POSITION_ENABLING_STOP = 13


_ROBOT = {mode.value: mode for mode in RobotMode}
_SAFETY = {mode.value: mode for mode in SafetyMode}
PLAYING, STOPPED = 2, 1
"""Of ``runtime``: whether a program runs."""

_SAFETY_WORDS = {
    SafetyMode.PROTECTIVE_STOP: "protective stop: look why, then unlock it at the pendant",
    SafetyMode.RECOVERY: "recovery mode: bring the arm back within its safety limits at the pendant",
    SafetyMode.SAFEGUARD_STOP: "safeguard stop: close the safeguard, and reset it if it has a reset",
    SafetyMode.SYSTEM_EMERGENCY_STOP: "emergency stop of the machine: release it, then power the arm at the pendant",
    SafetyMode.ROBOT_EMERGENCY_STOP: "emergency stop: release the button, then power the arm at the pendant",
    SafetyMode.VIOLATION: "safety violation: restart the safety system at the pendant",
    SafetyMode.FAULT: "safety fault: restart the controller",
}
_ROBOT_WORDS = {
    RobotMode.POWER_OFF: "arm power is off: switch it on at the pendant",
    RobotMode.POWER_ON: "the arm is being powered",
    RobotMode.IDLE: "the brakes are on: release them at the pendant",
    RobotMode.BACKDRIVE: "the arm is moved by hand: leave that at the pendant",
    RobotMode.BOOTING: "the controller starts",
    RobotMode.CONFIRM_SAFETY: "a safety configuration waits to be confirmed at the pendant",
}


class State(NamedTuple):
    """One packet of RTDE."""

    t_s: float
    """Of the controller's clock, since it was switched on."""
    pose: Pose
    """Of the tool, measured."""
    speed_mm_s: float
    """Of the tool's tip."""
    force: tuple[float, ...]
    """Force [N] and torque [N m] at the tool, compensated by the controller, along the base's axes."""
    raw: tuple[float, ...]
    """The same as the wrist's sensor measures it, along the flange's axes; zeros where it is not asked for."""
    robot_mode: int
    safety_mode: int
    runtime: int
    payload_kg: float
    payload_cog_mm: tuple[float, ...]


def hurt(state: State) -> str | None:
    """Return how a person or the safety system keeps the arm from moving, or None."""
    mode = _SAFETY.get(state.safety_mode)
    if mode in (SafetyMode.NORMAL, SafetyMode.REDUCED):
        return None
    if mode is None:
        return f"safety mode {state.safety_mode}, which is not known here"
    return _SAFETY_WORDS.get(mode, mode.name.lower().replace("_", " "))


def idle(state: State) -> str | None:
    """Return why the drives cannot move the arm, or None."""
    mode = _ROBOT.get(state.robot_mode)
    if mode is RobotMode.RUNNING:
        return None
    if mode is None:
        return f"robot mode {state.robot_mode}, which is not known here"
    return _ROBOT_WORDS.get(mode, mode.name.lower().replace("_", " "))


def trouble(state: State) -> str | None:
    """Return what keeps the arm from moving at all, the safety system first, or None."""
    return hurt(state) or idle(state)
