"""What the guard beside a robot goes by: the forces of the newest window, and a zero that it takes by itself. Pure.

It does what the task does with the same samples (``services.rules.forces``), but at any time and without the task. A
zero that cannot be one, and a sensor that began anew since its zero was taken, are reasons to let nothing move on.
"""

from __future__ import annotations

import math

from msgspec.structs import replace

from services.rules.forces import Forces, TareError
from services.rules.window import ANEW, Rolling, Windows
from services.wire.actions import Increment
from services.wire.definition import Definition
from services.wire.messages import FtPacket, Home

_ONLY_HOME = "only home is taken"


class FrontEnd:
    """Samples of one robot's sensor, since its last ``home``."""

    def __init__(self, definition: Definition) -> None:
        self._forces = Forces(definition)
        self._rolling, self._windows = Rolling(definition.sensor.window), Windows(definition.sensor)
        self._follows = False
        self._arrived_t_ns = 0
        self.felt: FtPacket | None = None
        """The newest sample, or what the newest so many come to."""
        self.waits = False
        """Whether the episode's zero is still to be taken."""
        self.trouble: str | None = None
        """Why the sensor is not to be believed."""

    def homed(self, home: Home, arrived_t_ns: int) -> None:
        """Begin at a start pose, in the air, that samples show from a time of the sensor on [ns]."""
        self._forces.home(home)
        self._windows.begin(at_home=True)
        self._arrived_t_ns = arrived_t_ns
        self.trouble, self.waits = None, self._forces.tares

    def moved(self, increment: Increment) -> None:
        """Take note of a motion that was made."""
        if not self._forces.changes_nothing:
            self._forces.moved(increment)

    def take(self, packet: FtPacket) -> FtPacket:
        """Take samples; return what is felt."""
        if self._forces.tares:
            if packet.status & ANEW:
                self.began_anew()
            if self.waits:
                self._windows.take(packet)
                self._tare()
        self.felt = self._of(self._rolling.take(packet))
        return self.felt

    def greatest_n(self, packet: FtPacket) -> float:
        """Return the greatest force of a packet's single samples [N]."""
        loads = zip(packet.force_n, packet.torque_nm, strict=False)
        return max(math.hypot(*self._forces.of(load)[0]) for load in loads)

    def began_anew(self) -> None:
        """Take note that the sensor is another one, or was switched off: its zero is not known any more."""
        self._rolling.forget()
        self._windows.begin(at_home=True)
        self._follows = False
        if self._forces.tares and not self.waits and self.trouble is None:
            self.trouble = f"guard: tare: expected the sensor of the tare, got one that began anew since; {_ONLY_HOME}"

    def forget(self) -> None:
        """Take note that the next samples are those of an episode that begins again."""
        self._rolling.forget()

    def resumed(self) -> None:
        """Take note that somebody has looked."""
        self._follows = False

    def _tare(self) -> None:
        window = self._windows.after(self._arrived_t_ns)
        if window is None:
            return
        self.waits = False
        try:
            self._forces.tare(window, follows=self._follows)
            self._follows = True
        except TareError as error:
            self.trouble = f"guard: {error}"

    def _of(self, packet: FtPacket) -> FtPacket:
        if self._forces.changes_nothing or not packet.torque_nm:
            return packet
        force_n, torque_nm = self._forces.felt(packet)
        return replace(packet, force_n=(force_n,), torque_nm=(torque_nm,))
