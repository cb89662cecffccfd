"""The settings of the robot link, and its command line."""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass, field
from typing import Literal

from services.robot_link.serial_line import LineSettings
from services.robot_link.val2.dialects import DIALECTS, Name
from services.robot_link.val2.oat import CONVENTIONS, Convention
from services.wire.errors import TreenailError

Prompt = Literal["started", "arrived"]
PROMPTS: tuple[Prompt, ...] = ("started", "arrived")
_LOCATION = re.compile(r"^[A-Z][A-Z0-9]{0,14}\Z")


class SettingError(TreenailError):
    """A setting that cannot be used."""


@dataclass(frozen=True)
class ArmSettings:
    """How the arm is moved."""

    dialect: Name = "val2"
    convention: Convention | None = None
    """How TRANS takes O, A, T; None to go by the probe alone."""
    confirmed: bool = False
    """Whether the operator answers for ``convention``: no probe then."""
    prompt: Prompt = "started"
    """What the prompt after DO MOVE means (not public)."""
    start_location: str = "TREENAIL"
    """Taught: peg straight over the hole's centre, tip ``start_height_mm`` above the mouth; 1 to 15 letters, digits."""
    start_height_mm: float = 20.0
    """0 to 500 mm."""
    withdraw_mm: float = 40.0
    """How far the peg is pulled back along its axis before anything else in ``home``, 0 to 500 mm; 0 for not at all."""
    speed_percent: float | None = 10.0
    """Monitor speed, above 0 up to 100; None to leave it as it is."""
    decimals: int = 5
    """Of what is written in TRANS, 2 to 9. With fewer than 5, what is applied is not what was asked for to the bit."""
    within_mm: float = 0.08
    """How far from where it should be the arm counts as arrived, 0.001 to 5 mm."""
    within_deg: float = 0.08
    """0.001 to 5 degrees."""
    move_s: float = 10.0
    """How long one motion may take, 0.1 to 600 s."""
    settle_s: float = 0.02
    """From arrival to the first F/T sample that counts: for the arm to calm down and the sensor's filter, 0 to 10 s."""
    echo: bool = True
    """Whether the controller sends back what it is sent (assumed)."""
    tell_episode: bool = False
    """Assign EPISODE and STEP on the controller before home and moves."""

    def __post_init__(self) -> None:
        """Raise SettingError for what cannot be used."""
        if self.confirmed and self.convention is None:
            raise SettingError("--convention-confirmed: expected --convention with it, got none")
        if not _LOCATION.match(self.start_location):
            raise SettingError(
                f"--start: expected 1 to 15 of A-Z 0-9, a letter first, got {self.start_location[:20]!r}"
            )
        _within("--start-height-mm", self.start_height_mm, 0.0, 500.0)
        _within("--withdraw-mm", self.withdraw_mm, 0.0, 500.0)
        if self.speed_percent is not None:
            _within("--speed", self.speed_percent, 0.1, 100.0)
        _within("--decimals", self.decimals, 2, 9)
        _within("--within-mm", self.within_mm, 0.001, 5.0)
        _within("--within-deg", self.within_deg, 0.001, 5.0)
        _within("--move-s", self.move_s, 0.1, 600.0)
        _within("--settle-s", self.settle_s, 0.0, 10.0)


@dataclass(frozen=True)
class Settings:
    """What the robot link is started with."""

    url: str
    """pyserial URL."""
    line: LineSettings = field(default_factory=LineSettings)
    arm: ArmSettings = field(default_factory=ArmSettings)
    oldest_s: float = 0.1
    """Age above which an F/T sample says nothing about now, 0.01 to 10 s."""
    by_itself: bool = False
    """Whether the arm may move without ``treenail resume``, after the start and after a stop: for emulators alone."""

    def __post_init__(self) -> None:
        """Raise SettingError for what cannot be used."""
        _within("--oldest-s", self.oldest_s, 0.01, 10.0)


def add_arguments(made: argparse.ArgumentParser) -> None:
    """Add the robot link's options."""
    arm, line = ArmSettings(), LineSettings()
    made.add_argument("--url", required=True, help="pyserial URL: /dev/ttyS0, socket://HOST:PORT, rfc2217://HOST:PORT")
    made.add_argument("--baud", type=int, default=line.baud, help=f"bits per second (default: {line.baud})")
    made.add_argument("--parity", default=line.parity, choices=tuple("NEOMS"), help="parity (default: N, none)")
    made.add_argument("--stop", type=float, default=line.stop, choices=(1, 1.5, 2), help="stop bits (default: 1)")
    made.add_argument("--xonxoff", action="store_true", help="software flow control (default: none)")
    made.add_argument("--mode", choices=("terminal", "supervisory"), default="terminal", help="default: terminal")
    made.add_argument("--dialect", choices=tuple(DIALECTS), default=arm.dialect, help="default: val2")
    made.add_argument("--convention", choices=CONVENTIONS, help="how TRANS takes O, A, T (default: the probe says)")
    made.add_argument("--convention-confirmed", action="store_true", help="I have made sure of it: no probe")
    made.add_argument("--prompt", choices=PROMPTS, default=arm.prompt, help="what it means after DO MOVE")
    made.add_argument("--start", default=arm.start_location, help=f"taught location (default: {arm.start_location})")
    made.add_argument("--start-height-mm", type=float, default=arm.start_height_mm, help="its tip above the mouth (20)")
    made.add_argument("--withdraw-mm", type=float, default=arm.withdraw_mm, help="pull back before homing (40)")
    made.add_argument("--speed", type=float, default=arm.speed_percent, help="monitor speed in percent (10)")
    made.add_argument("--decimals", type=int, default=arm.decimals, help="of what is written in TRANS (5)")
    made.add_argument("--within-mm", type=float, default=arm.within_mm, help="counts as arrived (0.08)")
    made.add_argument("--within-deg", type=float, default=arm.within_deg, help="counts as arrived (0.08)")
    made.add_argument("--move-s", type=float, default=arm.move_s, help="longest time of a motion (10)")
    made.add_argument("--settle-s", type=float, default=arm.settle_s, help="from arrival to the first sample (0.02)")
    made.add_argument("--no-echo", action="store_true", help="the controller does not send back what it is sent")
    made.add_argument("--tell-episode", action="store_true", help="assign EPISODE and STEP before home and moves")
    made.add_argument("--oldest-s", type=float, default=Settings("").oldest_s, help="oldest F/T sample (0.1)")
    made.add_argument(
        "--auto-resume",
        action="store_true",
        help="an emulated arm: it moves without `treenail resume`, also after a stop",
    )


def settings(one: argparse.Namespace) -> Settings:
    """Return the settings in parsed arguments. Raises SettingError."""
    arm = ArmSettings(
        dialect=one.dialect,
        convention=one.convention,
        confirmed=one.convention_confirmed,
        prompt=one.prompt,
        start_location=one.start,
        start_height_mm=one.start_height_mm,
        withdraw_mm=one.withdraw_mm,
        speed_percent=one.speed,
        decimals=one.decimals,
        within_mm=one.within_mm,
        within_deg=one.within_deg,
        move_s=one.move_s,
        settle_s=one.settle_s,
        echo=not one.no_echo and one.mode == "terminal",
        tell_episode=one.tell_episode,
    )
    line = LineSettings(baud=one.baud, parity=one.parity, stop=one.stop, xonxoff=one.xonxoff)
    return Settings(one.url, line, arm, one.oldest_s, one.auto_resume)


def _within(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:  # what is no number never passes
        raise SettingError(f"{name}: expected {low:g} to {high:g}, got {value}")
