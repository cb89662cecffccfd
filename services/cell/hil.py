"""``treenail up hil``: the cell behind emulated hardware, with every byte of both old protocols in the loop.

    task -> robot_link -> serial bytes -> emulated controller -> sim -> emulated JR3 -> words -> sensor_jr3 -> task

The simulator stands in a cell of its own, where only the emulators meet it. It reads its forces in whole counts as the
receiver card does, so that the run ends in the same bytes as ``treenail up sim`` with the same definition.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from services.bus.ports import free_port
from services.cell.supervisor import Supervisor
from services.wire.definition import Definition, Sensor
from services.wire.errors import CellError

LINKS = ("terminal", "supervisory")
FULL_SCALES = ("sensor.full_scale_n=200", "sensor.full_scale_dnm=120")
"""Overrides for a definition whose sensor is not read in counts."""
THESIS_BAUD, THESIS_MOTION_S = 9600, 0.33
"""The thesis's serial line, and its three motions a second (3.3.1)."""
SENSOR_S = 5.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that are for ``up hil`` alone."""
    parser.add_argument(
        "--link", choices=LINKS, help="hil: how the controller is spoken to (default: terminal); supervisory is DDCMP"
    )
    parser.add_argument(
        "--thesis-speed",
        action="store_true",
        help="hil: a line of 9600 baud, motions of 0.33 s: about one decision a second, as in the thesis",
    )


def check(arguments: argparse.Namespace) -> None:
    """Raise CellError for options that do not go together."""
    if arguments.profile != "hil" and (arguments.link is not None or arguments.thesis_speed):
        raise CellError("--link, --thesis-speed: expected with `treenail up hil` only: the simulator has no line")
    if arguments.profile == "hil" and arguments.certs is not None:
        raise CellError("--certs: expected none with `treenail up hil`: the emulated hardware has no certificates")


def overrides(definition: Definition) -> Sequence[str]:
    """Return what has to be set in a definition so that a receiver card can give its forces.

    Raises CellError for start poses that a line of text does not carry to the last bit: the run would be another one.
    """
    for name in ("xy_spread_mm", "tilt_spread_deg"):
        if spread := getattr(definition.start, name):
            raise CellError(f"start.{name}: expected 0 with `treenail up hil`, a line carries 5 decimals, got {spread}")
    return () if definition.sensor.full_scale_n else FULL_SCALES


def start(supervisor: Supervisor, arguments: argparse.Namespace, endpoint: str, sensor: Sensor) -> None:
    """Start the simulator, both emulators and both drivers."""
    cell = ("--cell", arguments.cell, "--connect", endpoint)
    world = f"{arguments.cell}-world"
    mode = ("--mode", arguments.link or "terminal")
    baud = ("--baud", str(THESIS_BAUD)) if arguments.thesis_speed else ()
    slow = (*baud, "--motion-s", str(THESIS_MOTION_S)) if arguments.thesis_speed else ()
    scales = ",".join(str(scale) for scale in 3 * [sensor.full_scale_n] + 3 * [sensor.full_scale_dnm])
    arm, card = (f"127.0.0.1:{free_port()}" for _ in range(2))
    supervisor.start("sim", "--cell", world, "--connect", endpoint)
    follow = ("--world", world, "--sensor-s", str(SENSOR_S), "--prompt", "arrived")
    supervisor.start("robot_link.emulator", *cell, "--listen", arm, *follow, *mode, *slow)
    plugged = ("--calibration-s", "0", "--no-auto-zero", "--full-scales", scales)
    supervisor.start("sensor_jr3.emulator", *cell, "--listen", card, "--follow", world, *plugged)
    supervisor.start("sensor_jr3", *cell, "--url", f"tcp://{card}", "--full-scales", "keep", "--settle-s", "0")
    ideal = ("--prompt", "arrived", "--settle-s", "0", "--speed", "100", "--tell-episode")
    supervisor.start("robot_link", *cell, "--url", f"socket://{arm}", *ideal, *mode, *baud)
