"""The settings of the UR service, and its command line."""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass, field
from typing import Literal

from services.rules import arm_settings, mount
from services.rules.mount import Mount
from services.rules.settings import SettingError, add_settings, check, setting, settings_of
from services.wire.text import numbers

Wrist = Literal["tcp", "raw", "none"]
WRISTS: tuple[Wrist, ...] = ("tcp", "raw", "none")
Zeroing = Literal["home", "never"]
ZEROINGS: tuple[Zeroing, ...] = ("home", "never")
Six = tuple[float, ...]
_HOST = re.compile(r"^[A-Za-z0-9][A-Za-z0-9.:-]{0,252}\Z")
_FARTHEST_MM, _MOST_RAD = 3000.0, 7.0


@dataclass(frozen=True)
class Settings:
    """What the UR service is started with."""

    robot: str
    """Address or name of the controller."""
    start: Six | None = None
    """The taught start pose, as the pendant shows it: X, Y, Z [mm], rotation vector [rad]; None until somebody says."""
    start_height_mm: float = arm_settings.start_height_mm()
    withdraw_mm: float = arm_settings.withdraw_mm()
    speed_mm_s: float = setting(10.0, "of motions", within=(0.1, 250.0))
    acceleration_mm_s2: float = setting(100.0, "of motions", within=(1.0, 2500.0))
    within_mm: float = arm_settings.within_mm(0.05)
    within_deg: float = arm_settings.within_deg(0.05)
    move_s: float = arm_settings.move_s(30.0)
    settle_s: float = arm_settings.settle_s(0.05)
    rate_hz: float = setting(125.0, "of packets from the controller", within=(10.0, 500.0))
    watchdog_s: float = setting(2.0, "without us, after which the controller stops our program", within=(0.2, 10.0))
    wrist: Wrist = setting("tcp", "what is published as ft; none with a sensor of its own", choices=WRISTS)
    """``tcp``: compensated by the controller for its payload; ``raw``: as the sensor in the flange measures it."""
    zero: Zeroing = setting("home", "when the wrist is zeroed, in the air at the start pose", choices=ZEROINGS)
    air_n: float = setting(
        8.0, "largest force in the air that is still taken for drift, not payload", within=(0.1, 1000.0)
    )
    """Before it is zeroed away; users quote 4 N of drift."""
    payload_kg: float | None = setting(None, "that the controller must have set", within=(0.0, 50.0))
    payload_cog_mm: Six | None = None
    """Centre of gravity that the controller must have set; None for any."""
    tcp: Six | None = None
    """Tool in the flange that the controller must have set, X, Y, Z [mm], rotation vector [rad]; None for any."""
    mount: Mount = field(default_factory=Mount)
    unlock: bool = setting(False, "`treenail resume` may unlock a protective stop", "--unlock-protective-stop")
    power: bool = setting(False, "`treenail resume` may power the arm and release its brakes", "--power-on")
    any_firmware: bool = setting(False, "also with a version that nobody has tried")
    tell_episode: bool = setting(False, "write episode and step to input registers 18 and 19")
    oldest_s: float = arm_settings.oldest_s()
    by_itself: bool = setting(
        False, "an emulated arm: it moves without `treenail resume`, but for safety stops", "--auto-resume"
    )

    def __post_init__(self) -> None:
        """Raise SettingError for what cannot be used."""
        if not _HOST.match(self.robot):
            raise SettingError(f"--robot: expected an address as 192.168.0.10, got {self.robot[:60]!r}")
        if self.wrist == "none" and not self.mount.is_identity:
            raise SettingError("--mount: expected none with --wrist none, whose sensor has a mounting of its own")
        check(self, SettingError)


def add_arguments(made: argparse.ArgumentParser) -> None:
    """Add the options of the service."""
    made.add_argument("--robot", required=True, metavar="ADDRESS", help="of the controller: 192.168.0.10")
    made.add_argument("--start", metavar="X,Y,Z,RX,RY,RZ", help="start pose as the pendant shows it [mm, rad]")
    made.add_argument("--payload-cog-mm", metavar="X,Y,Z", help="centre of gravity that the controller must have set")
    made.add_argument("--tcp", metavar="X,Y,Z,RX,RY,RZ", help="TCP that the controller must have set [mm, rad]")
    mount.add_arguments(made, "the wrist's frame", "wrist")
    add_settings(made, Settings)


def settings(arguments: argparse.Namespace) -> Settings:
    """Return the settings in parsed arguments. Raises SettingError."""
    cog = arguments.payload_cog_mm
    return settings_of(
        Settings(arguments.robot),
        arguments,
        start=_pose("--start", arguments.start),
        tcp=_pose("--tcp", arguments.tcp),
        payload_cog_mm=None if cog is None else _numbers("--payload-cog-mm", cog, 3),
        mount=mount.parse(arguments.mount, arguments.negate),
    )


def _pose(option: str, text: str | None) -> Six | None:
    if text is None:
        return None
    values = _numbers(option, text, 6)
    if max(map(abs, values[3:])) > _MOST_RAD:
        raise SettingError(f"{option}: expected a rotation vector of at most {_MOST_RAD:g} rad, got {text[:80]!r}")
    return values


def _numbers(option: str, text: str, count: int) -> Six:
    try:
        values = tuple(numbers(text, count))
    except ValueError as error:
        raise SettingError(f"{option}: {error}") from None
    if max(map(abs, values)) > _FARTHEST_MM:
        raise SettingError(f"{option}: expected at most {_FARTHEST_MM:g} mm, got {text[:80]!r}")
    return values
