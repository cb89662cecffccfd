"""The settings of the sensor service, and its command line."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field

from services.rules.ft_counts import UNITS
from services.sensor_jr3 import mount, transform
from services.sensor_jr3.card import SettingError
from services.sensor_jr3.driver import ZERO, Setup
from services.sensor_jr3.mount import Mount
from services.sensor_jr3.stream import pace_of
from services.sensor_jr3.transports import check


@dataclass(frozen=True)
class Settings:
    """What the sensor service is started with."""

    url: str
    """Where the card is: ``isa:0x260`` or ``tcp://host:port``."""
    rate_hz: int = 1000
    """Samples a second: a divisor of 8000 from 8 up."""
    filter: int = 0
    """0 not filtered; 1 to 6: 500, 125, 31.25, 7.8, 1.95, 0.49 Hz."""
    batch: int | None = None
    """Samples a packet, 1 to 64; None for as many as come in a millisecond."""
    mount: Mount = field(default_factory=Mount)
    setup: Setup = field(default_factory=Setup)

    def __post_init__(self) -> None:
        """Raise SettingError for what cannot be used."""
        check(self.url)
        pace_of(self.rate_hz)
        if not 0 <= self.filter <= 6:
            raise SettingError(f"filter: expected 0 to 6, got {self.filter}")
        if self.batch is not None and not 1 <= self.batch <= 64:
            raise SettingError(f"batch: expected 1 to 64 samples a packet, got {self.batch}")

    @property
    def samples_a_packet(self) -> int:
        """Samples a packet, worked out."""
        return max(1, self.rate_hz // 1000) if self.batch is None else self.batch


def add_arguments(made: argparse.ArgumentParser) -> None:
    """Add the sensor's options."""
    made.add_argument(
        "--url", required=True, help="the card: isa:0x260, or tcp://host:port of a card server or emulator"
    )
    made.add_argument("--rate-hz", type=int, default=1000, help="samples a second, a divisor of 8000 (default: 1000)")
    made.add_argument("--filter", type=int, default=0, help="0 not filtered, 1-6: 500 to 0.49 Hz (default: 0)")
    made.add_argument("--batch", type=int, help="samples a packet, 1-64 (default: those of a millisecond)")
    made.add_argument("--mount", default="0,0,0,0,0,0", help="x,y,z,rx,ry,rz of the sensor in the wrist [mm, deg]")
    made.add_argument("--negate", action="store_true", help="the sensor reports what it does to the peg")
    made.add_argument("--zero", nargs="?", const="reset", choices=ZERO, default="no", help="take the load as zero")
    made.add_argument("--full-scales", default="default", help="default, keep, or six numbers in the card's unit")
    made.add_argument("--transform", default="", help="the card's own: TZ 12.5, RX 180; or keep (default: none)")
    made.add_argument("--offset-set", type=int, help="set of offsets to use, 0-15 (default: as it is)")
    made.add_argument("--units", choices=UNITS, help="unit system, instead of what the card says")
    made.add_argument("--settle-s", type=float, default=10.0, help="time for the sensor to settle (default: 10)")
    made.add_argument("--sensor-timeout-s", type=float, default=30.0, help="time for it to show up (default: 30)")


def settings(arguments: argparse.Namespace) -> Settings:
    """Return the settings in parsed arguments. Raises SettingError."""
    scales: tuple[int, ...] | str = arguments.full_scales
    if scales not in ("default", "keep"):
        scales = whole_numbers("--full-scales", arguments.full_scales, 1, 32767)
    setup = Setup(
        full_scales=scales,  # type: ignore[arg-type]
        transform=None if arguments.transform == "keep" else transform.parse(arguments.transform),
        offset_set=arguments.offset_set,
        zero=arguments.zero,
        units=arguments.units,
        settle_s=arguments.settle_s,
        sensor_timeout_s=arguments.sensor_timeout_s,
    )
    mounting = mount.parse(arguments.mount, arguments.negate)
    return Settings(arguments.url, arguments.rate_hz, arguments.filter, arguments.batch, mounting, setup)


def whole_numbers(name: str, text: str, low: int, high: int) -> tuple[int, ...]:
    """Return six whole numbers with commas between. Raises SettingError."""
    words = [word.strip() for word in text.split(",")]
    digits = len(words) == 6 and all(word.isascii() and word.isdigit() and len(word) < 7 for word in words)
    found = tuple(int(word) for word in words) if digits else ()
    if not found or not all(low <= one <= high for one in found):
        raise SettingError(f"{name}: expected six whole numbers from {low} to {high}, got {text[:80]!r}")
    return found


def address(text: str) -> tuple[str, int]:
    """Return host and port to listen on. Raises SettingError."""
    host, _, port = text.rpartition(":")
    if not (host and port.isascii() and port.isdigit() and int(port) <= 65535):
        raise SettingError(f"--listen: expected host:port, got {text[:80]!r}")
    return host.strip("[]"), int(port)
