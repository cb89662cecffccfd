"""The emulated box: what it sends, and when. Pure; time is an argument."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

Load = tuple[float, float, float, float, float, float]
Address = tuple[str, int]
FT_RATE_HZ = 7000
_LONGEST_BURST = 700
"""Records that are sent at once at most, when time was short."""
PAGE = """<?xml version="1.0" encoding="UTF-8"?>
<netft><runstat>0x00000000</runstat><prodname>Net F/T</prodname><setserial>{serial}</setserial>
<cfgnam>Gamma</cfgnam><calsn>{serial}</calsn><cfgcalsn>{serial}</cfgcalsn><cfgcpf>{per_force}</cfgcpf><cfgcpt>{per_torque}</cfgcpt>
<cfgfu>{force_code}</cfgfu><scfgfu>{force_unit}</scfgfu><cfgtu>{torque_code}</cfgtu><scfgtu>{torque_unit}</scfgtu>
<comrdte>1</comrdte><comrdtrate>{rate}</comrdtrate><comrdtbsiz>1</comrdtbsiz><setrate>7000</setrate></netft>
"""
_CODES = {"lbf": 1, "N": 2, "lbf-in": 1, "lbf-ft": 2, "N-m": 3}
UNITS = {
    "N": 1.0,
    "lbf": 4.4482216152605,
    "N-m": 1.0,
    "lbf-in": 4.4482216152605 * 0.0254,
    "lbf-ft": 4.4482216152605 * 0.3048,
}


@dataclass
class Faults:
    """What goes wrong on demand."""

    drop: int = 0
    repeat: int = 0
    swap: int = 0
    """Pairs of records that change places."""
    silent: bool = False
    pageless: bool = False
    garbage: int = 0
    """Packets of another length."""
    status: int = 0
    off: bool = False
    """Switched off: nobody is sent or answered anything."""


@dataclass
class Box:
    """One box."""

    loads: tuple[Load, ...] = ((0.0,) * 6,)
    """What is felt, a record each, over and over."""
    rate_hz: int = FT_RATE_HZ
    per_force: int = 1_000_000
    per_torque: int = 1_000_000
    force_unit: str = "N"
    torque_unit: str = "N-m"
    serial: str = "FT00001"
    faults: Faults = field(default_factory=Faults)
    bias: tuple[int, ...] = (0,) * 6
    peer: Address | None = None
    left: int = 0
    """Records that are still to be sent; -1 for ever."""
    sequence: int = 0
    sent_s: float = 0.0
    heard: list[tuple[int, int]] = field(default_factory=list)
    """Commands and their counts."""
    held: bytes | None = None

    def receive(self, data: bytes, peer: Address, now_s: float) -> None:
        """Take a request; what is none is passed over."""
        if self.faults.off or len(data) != 8 or data[:2] != b"\x12\x34":
            return
        command, count = int.from_bytes(data[2:4], "big"), int.from_bytes(data[4:], "big")
        self.heard = [*self.heard[-99:], (command, count)]
        if command in (2, 3):
            self.peer, self.left, self.sequence, self.sent_s = peer, count or -1, 0, now_s
        elif command == 0:
            self.peer = None
        elif command == 0x42:
            self.bias = self._raw()

    def due(self, now_s: float, send: Callable[[bytes, Address], object]) -> None:
        """Send what is due."""
        peer = self.peer  # the panel's thread may forget it meanwhile
        if peer is None:
            return
        number = min(int((now_s - self.sent_s) * self.rate_hz), _LONGEST_BURST)
        if self.left > 0:
            number = min(max(number, 1), self.left)
        if number <= 0:
            return
        self.sent_s = max(self.sent_s + number / self.rate_hz, now_s - 1.0)
        for _ in range(number):
            self._send_one(now_s, peer, send)
        if self.left > 0:
            self.left -= number
            self.peer = peer if self.left else None

    def reboot(self) -> None:
        """Be switched off and on again: nobody is sent anything."""
        self.peer, self.sequence, self.bias = None, 0, (0,) * 6

    def begin_anew(self) -> None:
        """Count from 0 again in the midst of a stream."""
        self.sequence = 0

    @property
    def page(self) -> bytes:
        """Its page."""
        return PAGE.format(
            serial=self.serial,
            per_force=self.per_force,
            per_torque=self.per_torque,
            force_unit=self.force_unit,
            torque_unit=self.torque_unit,
            force_code=_CODES[self.force_unit],
            torque_code=_CODES[self.torque_unit],
            rate=self.rate_hz,
        ).encode()

    def _raw(self) -> tuple[int, ...]:
        force = self.per_force / UNITS[self.force_unit]
        torque = self.per_torque / UNITS[self.torque_unit]
        load = self.loads[self.sequence % len(self.loads)]
        return tuple(round(value * (force if place < 3 else torque)) for place, value in enumerate(load))

    def _send_one(self, now_s: float, peer: Address, send: Callable[[bytes, Address], object]) -> None:
        self.sequence = (self.sequence + 1) % 2**32
        faults = self.faults
        if faults.silent:
            return
        if faults.drop > 0:
            faults.drop -= 1
            return
        counts = [value - nothing for value, nothing in zip(self._raw(), self.bias, strict=True)]
        head = (self.sequence, int(now_s * FT_RATE_HZ) % 2**32, faults.status)
        data = b"".join(part.to_bytes(4, "big") for part in head)
        data += b"".join(part.to_bytes(4, "big", signed=True) for part in counts)
        if faults.garbage > 0:
            faults.garbage -= 1
            send(data[:20], peer)
        if faults.swap > 0 and self.held is None:
            self.held = data
            return
        send(data, peer)
        if self.held is not None:
            faults.swap -= 1
            send(self.held, peer)
            self.held = None
        if faults.repeat > 0:
            faults.repeat -= 1
            send(data, peer)


def press(box: Box, line: str) -> str:
    """Do what a line for the panel says; return what is answered."""
    name, _, word = line.strip().partition(" ")
    try:
        match name:
            case "drop" | "repeat" | "swap" | "garbage":
                setattr(box.faults, name, int(word))
            case "silent" | "pageless":
                setattr(box.faults, name, bool(int(word)))
            case "status":
                box.faults.status = int(word, 16)
            case "off":
                box.reboot()
                box.faults.off = True
            case "on":
                box.faults.off = False
            case "reboot":
                box.reboot()
            case "begin_anew":
                box.begin_anew()
            case "load":
                x, y, z, mx, my, mz = map(float, word.split(","))
                box.loads = ((x, y, z, mx, my, mz),)
            case "another":
                box.serial, box.per_force = "FT00002", box.per_force // 2
                box.reboot()
            case "heard":
                return " ".join(f"{command:x}:{count}" for command, count in box.heard)
            case _:
                return f"expected {HELP}"
    except ValueError as error:
        return f"{name}: {error}"
    return "done"


HELP = (
    "drop N, repeat N, swap N (records); garbage N (packets); silent 1, 0; pageless 1, 0; status HEX; reboot; off; on; "
    "begin_anew; load FX,FY,FZ,MX,MY,MZ; another (sensor); heard"
)
