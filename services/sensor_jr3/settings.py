"""The settings of the sensor service, and its command line."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field

from services.rules import mount
from services.rules.mount import Mount
from services.rules.settings import SettingError, add_settings, check, setting, settings_of
from services.sensor_jr3 import transform, transports
from services.sensor_jr3.driver import Setup
from services.sensor_jr3.stream import pace_of


@dataclass(frozen=True)
class Settings:
    """What the sensor service is started with."""

    url: str
    """Where the card is: ``isa:0x260`` or ``tcp://host:port``."""
    rate_hz: int = setting(1000, "samples a second, a divisor of 8000", within=(8, 8000))
    filter: int = setting(0, "0: not filtered; 1: 500 Hz, down to 0.49 Hz", within=(0, 6))
    """1 to 6: 500, 125, 31.25, 7.8, 1.95, 0.49 Hz."""
    batch: int | None = setting(None, "samples a packet (default: those of a millisecond)", within=(1, 64))
    mount: Mount = field(default_factory=Mount)
    setup: Setup = field(default_factory=Setup)

    def __post_init__(self) -> None:
        """Raise SettingError for what cannot be used."""
        transports.check(self.url)
        pace_of(self.rate_hz)
        check(self, SettingError)

    @property
    def samples_a_packet(self) -> int:
        """Samples a packet, worked out."""
        return max(1, self.rate_hz // 1000) if self.batch is None else self.batch


def add_arguments(made: argparse.ArgumentParser) -> None:
    """Add the sensor's options."""
    made.add_argument(
        "--url", required=True, help="the card: isa:0x260, or tcp://host:port of a card server or emulator"
    )
    add_settings(made, Settings)
    mount.add_arguments(made)
    made.add_argument("--full-scales", default="default", help="default, keep, or six numbers in the card's unit")
    made.add_argument("--transform", default="", help="the card's own: TZ 12.5, RX 180; or keep (default: none)")
    add_settings(made, Setup)


def settings(arguments: argparse.Namespace) -> Settings:
    """Return the settings in parsed arguments. Raises SettingError."""
    scales: tuple[int, ...] | str = arguments.full_scales
    if scales not in ("default", "keep"):
        scales = whole_numbers("--full-scales", arguments.full_scales, 1, 32767)
    links = None if arguments.transform == "keep" else transform.parse(arguments.transform)
    setup = settings_of(Setup(), arguments, full_scales=scales, transform=links)
    mounting = mount.parse(arguments.mount, arguments.negate)
    return settings_of(Settings(arguments.url), arguments, mount=mounting, setup=setup)


def whole_numbers(name: str, text: str, low: int, high: int) -> tuple[int, ...]:
    """Return six whole numbers with commas between. Raises SettingError."""
    words = [word.strip() for word in text.split(",")]
    digits = len(words) == 6 and all(word.isascii() and word.isdigit() and len(word) < 7 for word in words)
    found = tuple(int(word) for word in words) if digits else ()
    if not found or not all(low <= one <= high for one in found):
        raise SettingError(f"{name}: expected six whole numbers from {low} to {high}, got {text[:80]!r}")
    return found
