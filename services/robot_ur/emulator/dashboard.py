"""The controller's dashboard server: a line in, a line out. Texts as in Universal Robots' "Dashboard Server" guide."""

from __future__ import annotations

from services.robot_ur.emulator.controller import (
    IDLE,
    PLAYING,
    POWER_OFF,
    ROBOT_MODES,
    RUNNING,
    SAFETY_MODES,
    STOPPED,
    Controller,
)

BANNER = b"Connected: Universal Robots Dashboard Server\n"
_LOCAL = ("power on", "power off", "brake release", "unlock protective stop", "play", "stop", "restart safety")


def reply(controller: Controller, line: str) -> str:
    """Return what is answered to a line."""
    line = line.strip()
    if line in _LOCAL and not controller.remote:
        return f"Command is not allowed due to safety reasons: {line} (not in remote control)"
    match line:
        case "PolyscopeVersion":
            major, minor, bugfix, build = controller.version
            return f"URSoftware {major}.{minor}.{bugfix}.{build} (Jan 01 2025)"
        case "get robot model":
            return "UR5"
        case "get serial number":
            return "20245500001"
        case "is in remote control":
            return str(controller.remote).lower()
        case "robotmode":
            return f"Robotmode: {ROBOT_MODES[controller.robot_mode]}"
        case "safetymode":
            return f"Safetymode: {SAFETY_MODES[controller.safety_mode]}"
        case "safetystatus":
            return f"Safetystatus: {SAFETY_MODES[controller.safety_mode]}"
        case "running":
            return f"Program running: {str(controller.runtime == PLAYING).lower()}"
        case "programState":
            return "PLAYING" if controller.runtime == PLAYING else "STOPPED"
        case "get loaded program":
            return "No program loaded"
        case "power on":
            return "Powering on" if controller.robot_mode >= IDLE or controller.power(IDLE) else f"Failed: {line}"
        case "power off":
            return "Powering off" if controller.power(POWER_OFF) else f"Failed: {line}"
        case "brake release":
            return "Brake releasing" if controller.power(RUNNING) else f"Failed: {line}"
        case "unlock protective stop":
            return controller.unlock()
        case "close safety popup":
            return "closing safety popup"
        case "close popup":
            return "closing popup"
        case "restart safety":
            return "Restarting safety"
        case "stop":
            controller.runtime = STOPPED
            return "Stopped"
        case "quit":
            return "Disconnected"
        case _:
            return "showing popup" if line.startswith("popup ") else f'could not understand: "{line[:60]}"'
