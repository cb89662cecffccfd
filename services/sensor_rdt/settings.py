"""The settings of the RDT service, and its command line."""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass, field

from services.rules import mount
from services.rules.mount import Mount
from services.rules.settings import SettingError, add_settings, check, setting, settings_of
from services.sensor_rdt.calibration import FORCE_UNITS, TORQUE_UNITS
from services.sensor_rdt.records import PORT

_HOST = re.compile(r"^[A-Za-z0-9][A-Za-z0-9.-]{0,252}\Z")


@dataclass(frozen=True)
class Settings:
    """What the RDT service is started with."""

    box: str
    """Address or name."""
    port: int = setting(PORT, "of the box, UDP", within=(1, 65535))
    page_port: int = setting(80, "of its page with the calibration", within=(1, 65535))
    counts_per_force: float | None = setting(None, "instead of its page's", within=(1e-6, 1e12))
    counts_per_torque: float | None = setting(None, "instead of its page's", within=(1e-6, 1e12))
    force_unit: str = setting("N", "of --counts-per-force", choices=("N", *FORCE_UNITS))
    torque_unit: str = setting("Nm", "of --counts-per-torque", choices=("Nm", *TORQUE_UNITS))
    rate_hz: float | None = setting(None, "that the box is set to (default: its page's)", within=(1.0, 8000.0))
    batch: int | None = setting(None, "samples a packet (default: those of 2 ms)", within=(1, 64))
    zero: bool = setting(False, "take the load at the start for nothing: nothing may touch the peg then")
    onrobot_filter: int | None = setting(None, "OnRobot: 0 none, 1 to 6 for 500 down to 1.5 Hz", within=(0, 6))
    onrobot_period_ms: int | None = setting(None, "OnRobot: between two records", within=(0, 254))
    mount: Mount = field(default_factory=Mount)

    def __post_init__(self) -> None:
        """Raise SettingError for what cannot be used."""
        if not _HOST.match(self.box):
            raise SettingError(f"--box: expected an address as 192.168.1.1, got {self.box[:60]!r}")
        if (self.counts_per_force is None) != (self.counts_per_torque is None):
            raise SettingError("--counts-per-force, --counts-per-torque: expected both or none")
        check(self, SettingError)


def add_arguments(made: argparse.ArgumentParser) -> None:
    """Add the options of the service."""
    made.add_argument("--box", required=True, metavar="ADDRESS", help="of the Net F/T, Axia or HEX: 192.168.1.1")
    mount.add_arguments(made)
    add_settings(made, Settings)


def settings(arguments: argparse.Namespace) -> Settings:
    """Return the settings in parsed arguments. Raises SettingError."""
    return settings_of(Settings(arguments.box), arguments, mount=mount.parse(arguments.mount, arguments.negate))
