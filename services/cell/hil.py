"""``treenail up hil``: the cell behind emulated hardware, with every byte of both old protocols in the loop.

    task -> robot_link -> serial bytes -> emulated controller -> sim -> emulated JR3 -> words -> sensor_jr3 -> task

The simulator stands in a cell of its own, where only the emulators meet it. It reads its forces in whole counts as the
receiver card does, so that the run ends in the same bytes as ``treenail up sim`` with the same definition.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from services.bus.ports import free_port
from services.wire.definition import Definition, Sensor
from services.wire.errors import CellError

LINKS = ("terminal", "supervisory")
FULL_SCALES = ("sensor.full_scale_n=200", "sensor.full_scale_dnm=120")
"""Overrides for a definition whose sensor is not read in counts."""
THESIS_BAUD, THESIS_MOTION_S = 9600, 0.33
"""The thesis's serial line, and its three motions a second (3.3.1)."""
SENSOR_S = 5.0
DECIMALS = 4
"""Of a start pose [mm, deg]: what the emulated arms take for exact."""
RATE_HZ, CARD_HZ = 1000, 8000
"""Samples a second of the emulated card unless a definition wants others; those that it has, and can divide."""


def is_card_rate(rate_hz: int) -> bool:
    """Return whether a receiver card gives so many samples a second."""
    return 8 <= rate_hz <= CARD_HZ and CARD_HZ % rate_hz == 0


@dataclass(frozen=True)
class Hil:
    """Emulated hardware: how it is spoken to, and where on this machine. See services.cell.plan.Hardware."""

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

    def overrides(self, definition: Definition) -> Sequence[str]:
        """See Hardware."""
        return for_emulated(definition, "hil", is_card_rate, RATE_HZ)

    def commands(self, cell: str, endpoint: str, sensor: Sensor) -> dict[str, tuple[str, ...]]:
        """See Hardware: simulator, both emulators, both drivers."""
        here = ("--cell", cell, "--connect", endpoint)
        world = f"{cell}-world"
        mode = ("--mode", self.link)
        baud = ("--baud", str(THESIS_BAUD)) if self.thesis_speed else ()
        slow = (*baud, "--motion-s", str(THESIS_MOTION_S)) if self.thesis_speed else ()
        scales = ",".join(str(scale) for scale in 3 * [sensor.full_scale_n] + 3 * [sensor.full_scale_dnm])
        follow = ("--world", world, "--sensor-s", str(SENSOR_S), "--prompt", "arrived")
        plugged = ("--calibration-s", "0", "--no-auto-zero", "--no-filters", "--full-scales", scales)
        rate = ("--rate-hz", str(sensor.rate_hz if is_card_rate(sensor.rate_hz) else RATE_HZ))
        keep = ("--full-scales", "keep", "--settle-s", "0", *rate)
        ideal = ("--prompt", "arrived", "--settle-s", "0", "--speed", "100", "--tell-episode", "--auto-resume")
        return {
            "sim": ("--cell", world, "--connect", endpoint),
            "robot_link.emulator": (*here, "--listen", self.arm, *follow, *mode, *slow),
            "sensor_jr3.emulator": (*here, "--listen", self.card, "--follow", world, *plugged, *rate),
            "sensor_jr3": (*here, "--url", f"tcp://{self.card}", *keep),
            "robot_link": (*here, "--url", f"socket://{self.arm}", *ideal, *mode, *baud),
        }


def emulated(link: str = "terminal", *, thesis_speed: bool = False) -> Hil:
    """Return emulated hardware on free ports of this machine."""
    arm, card = (f"127.0.0.1:{free_port()}" for _ in range(2))
    return Hil(link, thesis_speed, arm, card)


def for_emulated(definition: Definition, profile: str, rates: Callable[[int], bool], rate_hz: int) -> Sequence[str]:
    """Return what has to be set in a definition so that emulated hardware can make its starts and give its forces.

    Forces are in whole counts; random starts are on the grid of the emulated arm; where several samples make a force,
    or a rate is stated, they come at one for which ``rates`` holds, else at ``rate_hz``. Raises CellError for rotations
    about another point than the tip.
    """
    if centre_mm := definition.moves.rotation_centre_mm:
        why = "its arm turns about the peg's tip"
        raise CellError(f"moves.rotation_centre_mm: expected 0 with `treenail up {profile}`, {why}, got {centre_mm}")
    start, sensor = definition.start, definition.sensor
    off_grid = any(start.spreads) and not 0 < start.decimals <= DECIMALS
    rate_counts = sensor.rate_hz > 0 or max(sensor.window, sensor.tare_samples) > 1
    return (
        *(() if sensor.full_scale_n else FULL_SCALES),
        *((f"start.decimals={DECIMALS}",) if off_grid else ()),
        *((f"sensor.rate_hz={rate_hz}",) if rate_counts and not rates(sensor.rate_hz) else ()),
    )
