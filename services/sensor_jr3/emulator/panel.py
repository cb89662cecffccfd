"""``python -m services.sensor_jr3.emulator.panel tcp://127.0.0.1:PORT pull 1``: make the emulator fail, or work."""

from __future__ import annotations

from services.bus import command
from services.rules.command_line import Parser, whole
from services.rules.settings import SettingError
from services.sensor_jr3.emulator.faults import FAULTS
from services.sensor_jr3.tcp import TcpCard
from services.sensor_jr3.transports import host_and_port


def press(url: str, name: str, value: int) -> None:
    """Set a fault of the emulator at a URL. Raises SettingError for an unknown one, LinkError without emulator."""
    if name not in FAULTS or not 0 <= value <= 0xFFFF:
        raise SettingError(f"fault: expected {', '.join(FAULTS)} and 0 to 65535, got {name[:20]} {value}")
    card = TcpCard(*host_and_port(url))
    try:
        card.write(FAULTS[name][0], value)
    finally:
        card.close()


def main() -> None:
    """Parse the command line and press."""
    parser = Parser(
        prog="python -m services.sensor_jr3.emulator.panel",
        description="; ".join(f"{name} {meaning}" for name, (_, meaning) in FAULTS.items()),
    )
    parser.add_argument("url", help="tcp://host:port of the emulator")
    parser.add_argument("fault", choices=FAULTS)
    parser.add_argument("value", type=whole(0, 0xFFFF))
    arguments = parser.parse_args()
    press(arguments.url, arguments.fault, arguments.value)


if __name__ == "__main__":
    command.run("jr3-panel", main)
