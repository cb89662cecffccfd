"""``treenail up hil``: the cell behind emulated hardware, with every byte of both old protocols in the loop.

    task -> robot_link -> serial bytes -> emulated controller -> sim -> emulated JR3 -> words -> sensor_jr3 -> task

The simulator stands in a cell of its own, where only the emulators meet it. It reads its forces in whole counts as the
receiver card does, so that the run ends in the same bytes as ``treenail up sim`` with the same definition.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from services.bus.ports import free_port
from services.wire.definition import SPREADS, Definition, Sensor
from services.wire.errors import CellError

LINKS = ("terminal", "supervisory")
FULL_SCALES = ("sensor.full_scale_n=200", "sensor.full_scale_dnm=120")
"""Overrides for a definition whose sensor is not read in counts."""
THESIS_BAUD, THESIS_MOTION_S = 9600, 0.33
"""The thesis's serial line, and its three motions a second (3.3.1)."""
SENSOR_S = 5.0


@dataclass(frozen=True)
class Hil:
    """How the emulated hardware is spoken to, and where on this machine."""

    link: str
    """One of LINKS."""
    thesis_speed: bool
    """A line of 9600 baud and motions of 0.33 s."""
    arm: str
    """Address of the emulated controller, as host:port."""
    card: str
    """Address of the emulated receiver card, as host:port."""
    emulated: bool = True
    services: tuple[str, ...] = ("robot_link", "sensor_jr3")
    """What is in the cell itself."""


def emulated(link: str = "terminal", *, thesis_speed: bool = False) -> Hil:
    """Return emulated hardware on free ports of this machine."""
    arm, card = (f"127.0.0.1:{free_port()}" for _ in range(2))
    return Hil(link, thesis_speed, arm, card)


def overrides(definition: Definition, profile: str = "hil") -> Sequence[str]:
    """Return what has to be set in a definition so that emulated hardware can give its forces, in whole counts.

    Raises CellError for what makes another run of it: start poses that do not reach the simulator to the last bit,
    rotations about another point than the tip, and a window of several samples.
    """
    for name in SPREADS:
        if spread := getattr(definition.start, name):
            raise CellError(
                f"start.{name}: expected 0 with `treenail up {profile}`, its arm goes by steps of 0.0001, got {spread}"
            )
    if centre_mm := definition.moves.rotation_centre_mm:
        why = "its arm turns about the peg's tip"
        raise CellError(f"moves.rotation_centre_mm: expected 0 with `treenail up {profile}`, {why}, got {centre_mm}")
    if definition.sensor.window > 1:
        expected = (
            f"expected 1 with `treenail up {profile}`, whose emulated sensor shows one load until the next motion"
        )
        raise CellError(f"sensor.window: {expected}, got {definition.sensor.window}")
    return () if definition.sensor.full_scale_n else FULL_SCALES


def commands(hardware: Hil, cell: str, endpoint: str, sensor: Sensor) -> dict[str, tuple[str, ...]]:
    """Return the options of the simulator, both emulators and both drivers, in the order of starting."""
    here = ("--cell", cell, "--connect", endpoint)
    world = f"{cell}-world"
    mode = ("--mode", hardware.link)
    baud = ("--baud", str(THESIS_BAUD)) if hardware.thesis_speed else ()
    slow = (*baud, "--motion-s", str(THESIS_MOTION_S)) if hardware.thesis_speed else ()
    scales = ",".join(str(scale) for scale in 3 * [sensor.full_scale_n] + 3 * [sensor.full_scale_dnm])
    follow = ("--world", world, "--sensor-s", str(SENSOR_S), "--prompt", "arrived")
    plugged = ("--calibration-s", "0", "--no-auto-zero", "--full-scales", scales)
    keep = ("--full-scales", "keep", "--settle-s", "0")
    ideal = ("--prompt", "arrived", "--settle-s", "0", "--speed", "100", "--tell-episode", "--auto-resume")
    return {
        "sim": ("--cell", world, "--connect", endpoint),
        "robot_link.emulator": (*here, "--listen", hardware.arm, *follow, *mode, *slow),
        "sensor_jr3.emulator": (*here, "--listen", hardware.card, "--follow", world, *plugged),
        "sensor_jr3": (*here, "--url", f"tcp://{hardware.card}", *keep),
        "robot_link": (*here, "--url", f"socket://{hardware.arm}", *ideal, *mode, *baud),
    }
