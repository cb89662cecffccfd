"""What a person, a cable or bad luck does to the emulated controller: a line of text each, for people and tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from services.robot_ur.emulator.controller import (
    IDLE,
    NORMAL,
    POWER_OFF,
    REDUCED,
    ROBOT_STOP,
    RUNNING,
    SAFEGUARD,
    SYSTEM_STOP,
    Controller,
)

HELP = (
    "protect; unlock; protect_in_motion; estop, system_estop, safeguard, reduced: 1, 0; power 0 (off), 1 (idle), "
    "2 (running); remote 0, 1; stop_program; drop N (RTDE packets); slow MS; jump S (of the clock); pull 1, 0; hangup; "
    "busy 1, 0; forget NAME (an output); firmware A.B; payload KG (that is set); weigh KG (that hangs there beyond "
    "it); short MM (how far before their goal motions end); motion MS; unlock_after S; reset; show"
)
_POWER = (POWER_OFF, IDLE, RUNNING)


def press(controller: Controller, line: str) -> str:
    """Do what a line says; return what is answered: done, or what was expected."""
    name, _, word = line.strip().partition(" ")
    if name == "show":
        x, y, z, *_ = controller.pose
        modes = f"{controller.robot_mode} {controller.safety_mode} {controller.runtime}"
        return f"{modes} {1000.0 * x:.6f} {1000.0 * y:.6f} {1000.0 * z:.6f}"
    try:
        what = _DO[name]
    except KeyError:
        return f"expected {HELP}"
    try:
        what(controller, word)
    except (ValueError, IndexError) as error:
        return f"{name}: {error}"
    return "done"


def _stop(mode: int) -> Callable[[Controller, str], None]:
    return lambda controller, word: controller.stop_by_hand(mode if int(word) else NORMAL)


def _remote(controller: Controller, word: str) -> None:
    controller.remote = bool(int(word))


def _stop_program(controller: Controller, word: str) -> None:
    controller.runtime = 1


def _fault(name: str, convert: Callable[[str], object]) -> Callable[[Controller, str], None]:
    return lambda controller, word: setattr(controller.faults, name, convert(word or "1"))


def _forget(controller: Controller, word: str) -> None:
    controller.faults.missing.add(word)


def _firmware(controller: Controller, word: str) -> None:
    major, minor = word.split(".")
    controller.behaviour = replace(controller.behaviour, version=(int(major), int(minor), 0, 0))


def _payload(controller: Controller, word: str) -> None:
    controller.payload_kg = float(word)


def _behave(name: str, convert: Callable[[str], float]) -> Callable[[Controller, str], None]:
    def behave(controller: Controller, word: str) -> None:
        controller.behaviour = replace(controller.behaviour, **{name: convert(word)})  # type: ignore[arg-type]

    return behave


_DO: dict[str, Callable[[Controller, str], object]] = {
    "protect": lambda controller, word: controller.protect(),
    "unlock": lambda controller, word: controller.unlock(),
    "protect_in_motion": _fault("stop_in_motion", lambda word: bool(int(word))),
    "estop": _stop(ROBOT_STOP),
    "system_estop": _stop(SYSTEM_STOP),
    "safeguard": _stop(SAFEGUARD),
    "reduced": _stop(REDUCED),
    "power": lambda controller, word: controller.power(_POWER[int(word)]),
    "remote": _remote,
    "stop_program": _stop_program,
    "drop": _fault("drop", int),
    "slow": _fault("slow_s", lambda word: float(word) / 1000.0),
    "jump": _fault("jump_s", float),
    "pull": _fault("pulled", lambda word: bool(int(word))),
    "busy": _fault("busy", lambda word: bool(int(word))),
    "forget": _forget,
    "firmware": _firmware,
    "payload": _payload,
    "weigh": _fault("weigh_kg", float),
    "short": _fault("short_mm", float),
    "motion": _behave("motion_s", lambda word: float(word) / 1000.0),
    "unlock_after": _behave("unlock_after_s", float),
    "reset": lambda controller, word: controller.reset(),
}
