"""The settings of the robot link, and its command line."""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass, field
from typing import Literal

from services.robot_link.serial_line import LineSettings
from services.robot_link.val2.dialects import DIALECTS, Name
from services.robot_link.val2.oat import CONVENTIONS, Convention
from services.rules import arm_settings
from services.rules.settings import add_settings, check, setting, settings_of
from services.wire.errors import TreenailError

Prompt = Literal["started", "arrived"]
PROMPTS: tuple[Prompt, ...] = ("started", "arrived")
_LOCATION = re.compile(r"^[A-Z][A-Z0-9]{0,14}\Z")


class SettingError(TreenailError):
    """A setting that cannot be used."""


@dataclass(frozen=True)
class ArmSettings:
    """How the arm is moved."""

    dialect: Name = setting("val2", "how the controller speaks", choices=tuple(DIALECTS))
    convention: Convention | None = setting(
        None, "how TRANS takes O, A, T (default: the probe says)", choices=CONVENTIONS
    )
    confirmed: bool = setting(False, "I have made sure of it: no probe", "--convention-confirmed")
    prompt: Prompt = setting("started", "what the prompt after DO MOVE means", choices=PROMPTS)
    """Not public."""
    start_location: str = setting("TREENAIL", "taught location", "--start")
    """Peg straight over the hole's centre, tip ``start_height_mm`` above the mouth; 1 to 15 letters, digits."""
    start_height_mm: float = arm_settings.start_height_mm()
    withdraw_mm: float = arm_settings.withdraw_mm()
    speed_percent: float | None = setting(10.0, "monitor speed in percent", "--speed", within=(0.1, 100.0))
    """None to leave it as it is."""
    decimals: int = setting(5, "of what is written in TRANS", within=(2, 9))
    """With fewer than 5, what is applied is not what was asked for to the bit."""
    within_mm: float = arm_settings.within_mm(0.08)
    within_deg: float = arm_settings.within_deg(0.08)
    move_s: float = arm_settings.move_s(10.0)
    settle_s: float = arm_settings.settle_s(0.02)
    echo: bool = setting(True, "the controller does not send back what it is sent", "--no-echo")
    """Whether it does (assumed)."""
    tell_episode: bool = setting(False, "assign EPISODE and STEP on the controller before home and moves")

    def __post_init__(self) -> None:
        """Raise SettingError for what cannot be used."""
        if self.confirmed and self.convention is None:
            raise SettingError("--convention-confirmed: expected --convention with it, got none")
        if not _LOCATION.match(self.start_location):
            raise SettingError(
                f"--start: expected 1 to 15 of A-Z 0-9, a letter first, got {self.start_location[:20]!r}"
            )
        check(self, SettingError)


@dataclass(frozen=True)
class Settings:
    """What the robot link is started with."""

    url: str
    """pyserial URL."""
    line: LineSettings = field(default_factory=LineSettings)
    arm: ArmSettings = field(default_factory=ArmSettings)
    oldest_s: float = arm_settings.oldest_s()
    by_itself: bool = setting(
        False, "an emulated arm: it moves without `treenail resume`, also after a stop", "--auto-resume"
    )

    def __post_init__(self) -> None:
        """Raise SettingError for what cannot be used."""
        check(self, SettingError)


def add_arguments(made: argparse.ArgumentParser) -> None:
    """Add the robot link's options."""
    made.add_argument("--url", required=True, help="pyserial URL: /dev/ttyS0, socket://HOST:PORT, rfc2217://HOST:PORT")
    made.add_argument("--mode", choices=("terminal", "supervisory"), default="terminal", help="of the line")
    for part in (LineSettings, ArmSettings, Settings):
        add_settings(made, part)


def settings(one: argparse.Namespace) -> Settings:
    """Return the settings in parsed arguments. Raises SettingError."""
    arm = settings_of(ArmSettings(), one, echo=one.echo and one.mode == "terminal")
    return settings_of(Settings(one.url), one, line=settings_of(LineSettings(), one), arm=arm)
